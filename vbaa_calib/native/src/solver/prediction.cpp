#include "solver/prediction.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "lens.hpp"
#include "shapes.hpp"

namespace vbaa::solver {

namespace {

constexpr double STEP = 1e-4;              // finite difference of each unknown
constexpr double BEFORE_TIP = 1.0 - 1e-6;  // in antenna lengths: the last two nodes stay apart

// A camera's picture of a curve: its nodes, their depths, and its slopes by arc length there.
struct Nodes {
    double u[NODES], v[NODES], depth[NODES], slope_u[NODES], slope_v[NODES];
};

// Offset of the middle between a round antenna's visible edges from its axis: the edges are tangent to rays from the
// camera.
void off_axis(const Rig& rig, double contact_m, Nodes& nodes) {
    auto& [u, v, depth, slope_u, slope_v] = nodes;
    const double inner = contact_m / CONTACT, outer = (rig.length_m - contact_m) / NODES_BEYOND;
    for (int j = 0; j < NODES; ++j) {
        const double arc_m = j < CONTACT ? j * inner : contact_m + (j - CONTACT) * outer;
        const double radius = rig.radius_m / depth[j];
        const double size = rig.taper ? antenna::weight_at(rig.taper, arc_m / rig.length_m) : 1.0;
        // of the plane through the camera and the tangent
        const double normal[3] = {slope_v[j], -slope_u[j], v[j] * slope_u[j] - u[j] * slope_v[j]};
        const double square = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
        const double off = size * radius * radius * normal[2] / std::max(square, 1e-30);
        const double by_u = u[j] * normal[2] - normal[0], by_v = v[j] * normal[2] - normal[1];
        u[j] += off * by_u, v[j] += off * by_v;
    }
}

// One camera's picture of the first lane from its first node on: nodes, normals, and the cubics between them.
void curve(const Rig& rig, const Camera& camera, const Bent& bent, int clamp, Fit& fit) {
    const double inner = fit.contact_m / CONTACT, outer = (rig.length_m - fit.contact_m) / NODES_BEYOND;
    const auto& turn = camera.rotation;
    Nodes nodes;
    auto& [u, v, depth, slope_u, slope_v] = nodes;
    double normal_u[NODES], normal_v[NODES];
    for (int j = 0; j < NODES; ++j) {
        u[j] = bent.u(clamp + j, 0), v[j] = bent.v(clamp + j, 0), depth[j] = bent.depth(clamp + j, 0);
    }
    for (int j = 0; j < NODES; ++j) {
        const double x = bent.tangents[0][j], y = bent.tangents[1][j], z = bent.tangents[2][j];
        const double ahead = turn[2][0] * x + turn[2][1] * y + turn[2][2] * z, by_depth = 1.0 / depth[j];
        slope_u[j] = (turn[0][0] * x + turn[0][1] * y + turn[0][2] * z - u[j] * ahead) * by_depth;
        slope_v[j] = (turn[1][0] * x + turn[1][1] * y + turn[1][2] * z - v[j] * ahead) * by_depth;
        const double size = std::sqrt(slope_u[j] * slope_u[j] + slope_v[j] * slope_v[j]);
        const double by_size = 1.0 / std::max(size, 1e-30);
        normal_u[j] = -slope_v[j] * by_size, normal_v[j] = slope_u[j] * by_size;
    }
    const auto cubic = [](double start, double end, double leave, double arrive, double* coefficients) {
        const double gap = end - start;
        coefficients[0] = start, coefficients[1] = leave;
        coefficients[2] = 3.0 * gap - 2.0 * leave - arrive, coefficients[3] = leave + arrive - 2.0 * gap;
    };
    std::copy_n(u, NODES, &fit.u[clamp]);
    std::copy_n(v, NODES, &fit.v[clamp]);
    std::copy_n(depth, NODES, &fit.depth[clamp]);
    std::copy_n(normal_u, NODES, &fit.normal_u[clamp]);
    std::copy_n(normal_v, NODES, &fit.normal_v[clamp]);
    off_axis(rig, fit.contact_m, nodes);
    double* cubics = &fit.cubics(clamp, 0);
    for (int j = 0; j < LAST; ++j) {
        const double width = j < CONTACT ? inner : outer;
        cubic(u[j], u[j + 1], slope_u[j] * width, slope_u[j + 1] * width, cubics + 8 * j);
        cubic(v[j], v[j + 1], slope_v[j] * width, slope_v[j + 1] * width, cubics + 8 * j + 4);
    }
    std::copy_n(cubics + 8 * (LAST - 1), 8, cubics + 8 * LAST);
}

// The first lane's antenna and its pictures.
void curves(const Rig& rig, const Bent& bent, Fit& fit) {
    fit.contact_m = std::min(fit.unknowns[0], BEFORE_TIP) * rig.length_m;
    for (int axis = 0; axis < 3; ++axis) {
        for (int j = 0; j < NODES; ++j) fit.points_m[axis][j] = bent.points_m[axis][j][0];
        std::copy_n(bent.tangents[axis], NODES, fit.tangents[axis]);
    }
    int clamp = 0;
    for (const Camera& camera : rig.cameras) curve(rig, camera, bent, std::exchange(clamp, clamp + NODES), fit);
}

// Derivatives by the unknowns: displacements along the normals of the lanes that were moved.
void by_unknowns(const Bent& bent, Fit& fit, int free) {
    const Lanes by_step = load(bent.by_step);
    for (int j = 0; j < fit.nodes; ++j) {
        const double *u = &bent.u(j, 0), *v = &bent.v(j, 0);
        const Lanes moved =
            (load(u) - u[0]) * (by_step * fit.normal_u[j]) + (load(v) - v[0]) * (by_step * fit.normal_v[j]);
        for (int k = 0; k < free; ++k) fit.columns(j, k) = moved[1 + k];
    }
}

// Derivatives by friction on rungs with shapes that do not depend on it: only the force turns.
void friction_column(const Rig& rig, const double* available, Fit& fit) {
    constexpr int friction = UNKNOWNS - 1;
    for (int j = 0; j < fit.nodes; ++j) fit.columns(j, friction) = 0.0;
    const double* force = fit.point_force + 3;
    const double size = std::sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]) * rig.friction_rad;
    for (int axis = 0; axis < 3; ++axis) {
        fit.point_force_columns(axis, friction) = 0.0;
        fit.point_force_columns(3 + axis, friction) = -size * fit.tangents[axis][CONTACT];
    }
    // the moment about y is that of small deflections, on which friction has no part
    const auto turned = [&](int axis) { return fit.point_force_columns(3 + axis, friction); };
    const double *at = fit.point_force, x = turned(0), y = turned(1), z = turned(2);
    const ClampWrench change = {{x, y, z, at[1] * z - at[2] * y, 0.0, at[0] * y - at[1] * x, 0.0}};
    for (int reading = 0; reading < fit.readings; ++reading) {
        const bool read = rig.readings > USUAL_READINGS && reading != END;
        fit.reading_columns(reading, friction) =
            read ? read_by(rig.by_wrench[reading], change) * available[reading] : 0.0;
    }
}

// The pictures of all lanes.
void see(const Rig& rig, Bent& bent) {
    int clamp = 0;
    for (const Camera& camera : rig.cameras) {
        const auto& turn = camera.rotation;
        const double* shift = camera.translation_m;
        double *u = &bent.u(clamp, 0), *v = &bent.v(clamp, 0), *depth = &bent.depth(clamp, 0);
        for (int j = 0; j < NODES; ++j) {
            const Lanes x = load(bent.points_m[0][j]), y = load(bent.points_m[1][j]), z = load(bent.points_m[2][j]);
            const auto seen = [&](int axis) {
                return turn[axis][0] * x + turn[axis][1] * y + (turn[axis][2] * z + shift[axis]);
            };
            Lanes ahead = seen(2);
            ahead = where_positive(NEAREST_DEPTH_M - ahead, NEAREST_DEPTH_M, ahead);  // NaN stays NaN
            const Lanes by_depth = 1.0 / ahead;
            store(u + j * LANES, seen(0) * by_depth);
            store(v + j * LANES, seen(1) * by_depth);
            store(depth + j * LANES, ahead);
        }
        clamp += NODES;
    }
}

// Where a lane's tip lies along the antenna, in σ.
double tip_along(const Rig& rig, const Frame& frame, const Bent& bent, int lane, const TipAxis& end) {
    const int last = frame.tip_clamp + LAST;
    return bent.u(last, lane) * end.u + bent.v(last, lane) * end.v + rig.tip_offset_m * end.per_m;
}

// What is predicted of the first lane; returns its readings.
std::array<double, READINGS> put_prediction(const Rig& rig, const Frame& frame, const Bent& bent, Fit& fit) {
    curves(rig, bent, fit);
    const TipAxis end = fitted_tip_axis(rig, frame, fit);
    std::array<double, READINGS> base = {};
    const ClampWrench wrench = clamp_wrench(rig, frame, bent, 0);
    for (int reading = 0; reading < rig.readings; ++reading) {
        const bool tip = reading == END;
        const double read =
            tip ? frame.tip[0] * end.u + frame.tip[1] * end.v : frame.reading[reading] / rig.std[reading];
        base[reading] = tip ? tip_along(rig, frame, bent, 0, end) : read_by(rig.by_wrench[reading], wrench);
        fit.predicted_residual[reading] = (read - base[reading]) * frame.available[reading];
    }
    for (int axis = 0; axis < 3; ++axis) {
        fit.point_force[axis] = bent.points_m[axis][CONTACT][0];
        fit.point_force[3 + axis] = bent.force_N[axis][0];
    }
    return base;
}

// Bends all of them.
void bend_free(FreeShapes& found) {
    const Rig& rig = *found.rig;
    double parameters[ANTENNA][LANES], gravity[3][LANES], contact_m[LANES];
    const double none[2][LANES] = {};
    for (int k = 0; k < ANTENNA; ++k) store(parameters[k], spread(rig.antenna_parameters[k]));
    store(contact_m, spread(FREE * rig.length_m));
    for (int lane = 0; lane < LANES; ++lane) {
        const int row = std::min(lane, found.gravity_m_s2.shape[0] - 1);
        for (int axis = 0; axis < 3; ++axis) gravity[axis][lane] = found.gravity_m_s2(row, axis);
    }
    const antenna::Presses presses = {view(parameters), rig.length_m,          rig.taper,          view(gravity),
                                      view(contact_m),  {none[0], {2, LANES}}, {none[0], {LANES}}, false};
    antenna::bend_lanes(REFERENCE, presses,
                        {view(found.points_m), view(found.tangents), view(found.force_N), view(found.moment_Nm)});
    found.bent = true;
}

}  // namespace

Bent::Bent(const Rig& rig)
    : u(rig.nodes(), LANES),
      v(rig.nodes(), LANES),
      depth(rig.nodes(), LANES),
      by_step{},
      axes(rig.axes.shape[0], whole_lanes(UNKNOWNS + rig.shared)),
      raw(rig.samples(), whole_lanes(rig.axes.shape[0]) + LANES),
      raw_readings(rig.reading_rows(), whole_lanes(rig.axes.shape[0]) + LANES),
      raw_point_force(6, whole_lanes(rig.axes.shape[0]) + LANES) {
    for (int q = 0; q < axes.shape[0]; ++q) std::copy_n(rig.axes.row(q).begin(), rig.shared, &axes(q, UNKNOWNS));
}

void lay(const Rig& rig, Bent& bent, const Unknowns& unknowns) {
    for (int k = 0; k < ANTENNA; ++k) store(bent.parameters[k], spread(rig.antenna_parameters[k]));
    store(bent.contact_m, spread(unknowns[0] * rig.length_m));
    store(bent.push_N[0], spread(unknowns[1] * rig.force_unit_N));
    store(bent.push_N[1], spread(unknowns[2] * rig.force_unit_N));
    store(bent.friction_rad, spread(unknowns[3] * rig.friction_rad));
}

void bend_and_see(const Rig& rig, const Frame& frame, int rung, Bent& bent, bool with_tangents) {
    const Cube tangents(bent.tangents[0], {3, with_tangents ? WIDE_NODES / LANES : 0, LANES});
    const antenna::Presses presses = {view(bent.parameters),
                                      rig.length_m,
                                      rig.taper,
                                      ConstMatrix(frame.gravity_m_s2, {3, 1}),
                                      view(bent.contact_m),
                                      view(bent.push_N),
                                      view(bent.friction_rad),
                                      false};
    antenna::bend_lanes(rung, presses, {view(bent.points_m), tangents, view(bent.force_N), view(bent.moment_Nm)});
    see(rig, bent);
}

TipAxis tip_axis(const Frame& frame, double slope_u, double slope_v) {
    const double size = std::max(std::hypot(slope_u, slope_v), 1e-30), u = slope_u / size, v = slope_v / size;
    const auto& [xx, xy, yy] = frame.tip_covariance;
    const double std = std::sqrt(xx * u * u + 2.0 * xy * u * v + yy * v * v);
    return {u / std, v / std, size / std};
}

TipAxis fitted_tip_axis(const Rig& rig, const Frame& frame, const Fit& fit) {
    const double by_width = NODES_BEYOND / (rig.length_m - fit.contact_m);
    const double* last = &fit.cubics(frame.tip_clamp + LAST - 1, 0);
    return tip_axis(frame, (last[1] + 2.0 * last[2] + 3.0 * last[3]) * by_width,
                    (last[5] + 2.0 * last[6] + 3.0 * last[7]) * by_width);
}

Array<double, 2> point_jacobian(const Rig& rig, const Fit& fit) {
    Array<double, 2> image(2, fit.nodes);
    int clamp = 0;
    for (const Camera& camera : rig.cameras) {
        const auto& turn = camera.rotation;
        for (int j = clamp; j < clamp + NODES; ++j) {
            const double u = fit.normal_u[j], v = fit.normal_v[j], ahead = u * fit.u[j] + v * fit.v[j];
            for (int axis = 0; axis < 2; ++axis) {
                const double along = u * turn[0][1 + axis] + v * turn[1][1 + axis] - ahead * turn[2][1 + axis];
                image(axis, j) = along / fit.depth[j];
            }
        }
        clamp += NODES;
    }
    return image;
}

ClampWrench clamp_wrench(const Rig& rig, const Frame& frame, const Bent& bent, int lane) {
    ClampWrench wrench = {{0.0, 0.0, 0.0, 0.0, -bent.moment_Nm[lane], 0.0, 1.0}};
    if (!rig.with_wrench) return wrench;
    const double contact = std::min(bent.contact_m[lane], BEFORE_TIP * rig.length_m);
    const double inner = 0.5 * contact / CONTACT, outer = 0.5 * (rig.length_m - contact) / NODES_BEYOND;
    const double mass = std::exp(rig.antenna_parameters[7]);
    double centre[3] = {}, at[3], force[3], weights[LAST];
    for (int j = 0; j < LAST; ++j) {
        const int past = j < CONTACT ? 0 : j - CONTACT;
        weights[j] = j < CONTACT ? inner : outer;
        const double middle = 2.0 * ((j - past) * inner + past * outer) + weights[j];
        if (rig.taper) weights[j] *= antenna::weight_at(rig.taper, middle / rig.length_m);
    }
    for (int axis = 0; axis < 3; ++axis) {
        const auto& place = bent.points_m[axis];
        for (int j = 0; j < LAST; ++j) centre[axis] += weights[j] * (place[j][lane] + place[j + 1][lane]);
        at[axis] = place[CONTACT][lane], force[axis] = bent.force_N[axis][lane];
        wrench.values[axis] = force[axis] + mass * rig.taper.weight * rig.length_m * frame.gravity_m_s2[axis];
    }
    const auto moment = [&](int a, int b) {
        const double by_weight = centre[a] * frame.gravity_m_s2[b] - centre[b] * frame.gravity_m_s2[a];
        return at[a] * force[b] - at[b] * force[a] + mass * by_weight;
    };
    wrench.values[3] = moment(1, 2), wrench.values[5] = moment(0, 1);
    return wrench;
}

double read_by(const double (&row)[WRENCH], const ClampWrench& wrench) {
    double read = 0.0;
    for (int k = 0; k < WRENCH; ++k) read += row[k] * wrench.values[k];
    return read;
}

double by_force(const Rig& rig, int reading, int axis, double distance_m) {
    const auto& row = rig.by_wrench[reading];
    return row[1 + axis] + (axis == 0 ? row[5] : -row[4]) * distance_m;
}

void predict_free(const Rig& rig, const Frame& frame, Bent& bent, Fit& fit) {
    lay(rig, bent, fit.unknowns);
    if (frame.free == nullptr) {
        bend_and_see(rig, frame, REFERENCE, bent, true);
    } else {
        FreeShapes& known = *frame.free;
        if (!known.bent) bend_free(known);
        for (int axis = 0; axis < 3; ++axis) {
            for (int j = 0; j < NODES; ++j) {
                store(bent.points_m[axis][j], spread(known.points_m[axis][j][frame.lane]));
                bent.tangents[axis][j] = known.tangents[axis][j][frame.lane];
            }
            store(bent.force_N[axis], spread(known.force_N[axis][frame.lane]));
        }
        store(bent.moment_Nm, spread(known.moment_Nm[frame.lane]));
        see(rig, bent);
    }
    put_prediction(rig, frame, bent, fit);
}

void predict(const Rig& rig, const Frame& frame, int rung, Bent& bent, Fit& fit, bool derivatives) {
    const double back = fit.unknowns[0] + STEP > TIP ? -STEP : STEP;
    int free = 0;
    lay(rig, bent, fit.unknowns);
    if (derivatives) {
        free = rig.friction_rad > 0.0 && rung >= ELASTICA ? UNKNOWNS : UNKNOWNS - 1;
        // lanes 1 to 4 are moved
        bent.contact_m[1] += back * rig.length_m;
        bent.push_N[0][2] += STEP * rig.force_unit_N;
        bent.push_N[1][3] += STEP * rig.force_unit_N;
        if (free == UNKNOWNS) bent.friction_rad[4] += STEP * rig.friction_rad;
    }
    bend_and_see(rig, frame, rung, bent, true);
    const std::array<double, READINGS> base = put_prediction(rig, frame, bent, fit);
    const TipAxis end = fitted_tip_axis(rig, frame, fit);
    const double* available = frame.available;
    for (int k = 0; k < free; ++k) {
        const double by_step = 1.0 / (k == 0 ? back : STEP);
        bent.by_step[1 + k] = by_step;
        const ClampWrench moved = clamp_wrench(rig, frame, bent, k + 1);
        for (int reading = 0; reading < rig.readings; ++reading) {
            const double there =
                reading == END ? tip_along(rig, frame, bent, k + 1, end) : read_by(rig.by_wrench[reading], moved);
            fit.reading_columns(reading, k) = (there - base[reading]) * by_step * available[reading];
        }
        for (int axis = 0; axis < 3; ++axis) {
            const auto &point = bent.points_m[axis][CONTACT], &force = bent.force_N[axis];
            fit.point_force_columns(axis, k) = (point[k + 1] - point[0]) * by_step;
            fit.point_force_columns(3 + axis, k) = (force[k + 1] - force[0]) * by_step;
        }
    }
    if (free) by_unknowns(bent, fit, free);
    if (free == UNKNOWNS - 1) friction_column(rig, available, fit);
}

}  // namespace vbaa::solver
