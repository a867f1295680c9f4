#include "solver/prediction.hpp"

#include <algorithm>
#include <cmath>

#include "lens.hpp"
#include "shapes.hpp"

namespace vbaa::solver {

namespace {

constexpr double STEP = 1e-4;              // finite difference of each unknown
constexpr double BEFORE_TIP = 1.0 - 1e-6;  // in antenna lengths: the last two nodes stay apart

// x·f_y − y·f_x of force and weight about the antenna frame's origin, N·m.
double moment_about_z(const Rig& rig, const Frame& frame, const Bent& bent, int lane) {
    const auto &x = bent.points_m[0], &y = bent.points_m[1];
    const double contact = std::min(bent.contact_m[lane], BEFORE_TIP * rig.length_m);
    const double inner = 0.5 * contact / CONTACT, outer = 0.5 * (rig.length_m - contact) / NODES_BEYOND;
    double centre_x = 0.0, centre_y = 0.0;
    for (int j = 0; j < LAST; ++j) {
        double half_width = j < CONTACT ? inner : outer;
        if (rig.taper) {
            const double past = j < CONTACT ? 0.0 : j - CONTACT, middle = 2.0 * (j - past) * inner + 2.0 * past * outer;
            half_width *= antenna::weight_at(rig.taper, (middle + half_width) / rig.length_m);
        }
        centre_x += half_width * (x[j][lane] + x[j + 1][lane]);
        centre_y += half_width * (y[j][lane] + y[j + 1][lane]);
    }
    const double mass = std::exp(rig.antenna_parameters[7]);
    const double by_force = x[CONTACT][lane] * bent.force_N[1][lane] - y[CONTACT][lane] * bent.force_N[0][lane];
    return by_force + mass * (centre_x * frame.gravity_m_s2[1] - centre_y * frame.gravity_m_s2[0]);
}

// The first lane's picture: nodes, normals, and the cubics between them.
void curve(const Rig& rig, const Bent& bent, Fit& fit) {
    fit.contact_m = std::min(fit.unknowns[0], BEFORE_TIP) * rig.length_m;
    const double inner = fit.contact_m / CONTACT, outer = (rig.length_m - fit.contact_m) / NODES_BEYOND;
    const auto& turn = rig.rotation;
    double slope_u[NODES], slope_v[NODES];
    for (int j = 0; j < NODES; ++j) {
        for (int axis = 0; axis < 3; ++axis) fit.points_m[axis][j] = bent.points_m[axis][j][0];
        fit.u[j] = bent.u[j][0], fit.v[j] = bent.v[j][0], fit.depth[j] = bent.depth[j][0];
    }
    for (int j = 0; j < NODES; ++j) {
        const double x = bent.tangents[0][j], y = bent.tangents[1][j], z = bent.tangents[2][j];
        fit.tangents[0][j] = x, fit.tangents[1][j] = y, fit.tangents[2][j] = z;
        const double ahead = turn[2][0] * x + turn[2][1] * y + turn[2][2] * z, by_depth = 1.0 / fit.depth[j];
        slope_u[j] = (turn[0][0] * x + turn[0][1] * y + turn[0][2] * z - fit.u[j] * ahead) * by_depth;
        slope_v[j] = (turn[1][0] * x + turn[1][1] * y + turn[1][2] * z - fit.v[j] * ahead) * by_depth;
        const double size = std::sqrt(slope_u[j] * slope_u[j] + slope_v[j] * slope_v[j]);
        const double by_size = 1.0 / std::max(size, 1e-30);
        fit.normal_u[j] = -slope_v[j] * by_size, fit.normal_v[j] = slope_u[j] * by_size;
    }
    const auto cubic = [](double start, double end, double leave, double arrive, double* coefficients) {
        const double gap = end - start;
        coefficients[0] = start, coefficients[1] = leave;
        coefficients[2] = 3.0 * gap - 2.0 * leave - arrive, coefficients[3] = leave + arrive - 2.0 * gap;
    };
    for (int j = 0; j < LAST; ++j) {
        const double width = j < CONTACT ? inner : outer;
        cubic(fit.u[j], fit.u[j + 1], slope_u[j] * width, slope_u[j + 1] * width, fit.cubics[j]);
        cubic(fit.v[j], fit.v[j + 1], slope_v[j] * width, slope_v[j + 1] * width, fit.cubics[j] + 4);
    }
    std::copy_n(fit.cubics[LAST - 1], 8, fit.cubics[LAST]);
}

// Displacements along the normals, of the lanes that were moved.
void by_unknowns(const Bent& bent, Fit& fit, int free) {
    const Lanes by_step = load(bent.by_step);
    for (int j = 0; j < NODES; ++j) {
        const Lanes moved = (load(bent.u[j]) - bent.u[j][0]) * (by_step * fit.normal_u[j]) +
                            (load(bent.v[j]) - bent.v[j][0]) * (by_step * fit.normal_v[j]);
        for (int k = 0; k < free; ++k) fit.columns(j, k) = moved[1 + k];
    }
}

// By friction on the rungs whose shapes do not depend on it: only the force turns.
void friction_column(const Rig& rig, Fit& fit) {
    constexpr int friction = UNKNOWNS - 1;
    for (int j = 0; j < NODES; ++j) fit.columns(j, friction) = 0.0;
    for (int reading = 0; reading < 3; ++reading) fit.reading_columns(reading, friction) = 0.0;
    const double* force = fit.point_force + 3;
    const double size = std::sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]) * rig.friction_rad;
    for (int axis = 0; axis < 3; ++axis) {
        fit.point_force_columns(axis, friction) = 0.0;
        fit.point_force_columns(3 + axis, friction) = -size * fit.tangents[axis][CONTACT];
    }
}

}  // namespace

Bent::Bent(const Rig& rig)
    : by_step{},
      axes(rig.axes.shape[0], whole_lanes(UNKNOWNS + rig.shared)),
      raw(NODES, whole_lanes(rig.axes.shape[0]) + LANES),
      raw_readings(3, whole_lanes(rig.axes.shape[0]) + LANES),
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
    antenna::bend_lanes(rung, view(bent.parameters), rig.length_m, rig.taper, frame.gravity_m_s2, view(bent.contact_m),
                        view(bent.push_N), view(bent.friction_rad), view(bent.points_m), tangents, view(bent.force_N),
                        view(bent.moment_Nm));
    const auto& turn = rig.rotation;
    const double* shift = rig.translation_m;
    for (int j = 0; j < NODES; ++j) {
        const Lanes x = load(bent.points_m[0][j]), y = load(bent.points_m[1][j]), z = load(bent.points_m[2][j]);
        const auto seen = [&](int axis) {
            return turn[axis][0] * x + turn[axis][1] * y + (turn[axis][2] * z + shift[axis]);
        };
        Lanes ahead = seen(2);
        ahead = where_positive(NEAREST_DEPTH_M - ahead, NEAREST_DEPTH_M, ahead);  // NaN stays NaN
        const Lanes by_depth = 1.0 / ahead;
        store(bent.u[j], seen(0) * by_depth);
        store(bent.v[j], seen(1) * by_depth);
        store(bent.depth[j], ahead);
    }
}

TipAxis tip_axis(const Frame& frame, double slope_u, double slope_v) {
    const double size = std::max(std::hypot(slope_u, slope_v), 1e-30), u = slope_u / size, v = slope_v / size;
    const auto& [xx, xy, yy] = frame.tip_covariance;
    const double std = std::sqrt(xx * u * u + 2.0 * xy * u * v + yy * v * v);
    return {u / std, v / std, size / std};
}

TipAxis fitted_tip_axis(const Rig& rig, const Frame& frame, const Fit& fit) {
    const double by_width = NODES_BEYOND / (rig.length_m - fit.contact_m);
    const auto& last = fit.cubics[LAST - 1];
    return tip_axis(frame, (last[1] + 2.0 * last[2] + 3.0 * last[3]) * by_width,
                    (last[5] + 2.0 * last[6] + 3.0 * last[7]) * by_width);
}

void point_jacobian(const Rig& rig, const Fit& fit, double (&image)[2][NODES]) {
    const auto& turn = rig.rotation;
    for (int j = 0; j < NODES; ++j) {
        const double u = fit.normal_u[j], v = fit.normal_v[j], ahead = u * fit.u[j] + v * fit.v[j];
        for (int axis = 0; axis < 2; ++axis) {
            const double along = u * turn[0][1 + axis] + v * turn[1][1 + axis] - ahead * turn[2][1 + axis];
            image[axis][j] = along / fit.depth[j];
        }
    }
}

double predicted_moment(const Rig& rig, const Frame& frame, const Bent& bent, int lane, int about) {
    double moment = 0.0;
    if (about == 0) moment = bent.moment_Nm[lane];
    if (about == 1 && rig.with_second_sensor) moment = moment_about_z(rig, frame, bent, lane);
    return (rig.gain[about] * moment + rig.offset[about]) / rig.std[about];
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
    curve(rig, bent, fit);
    const TipAxis end = fitted_tip_axis(rig, frame, fit);
    const auto tip_of = [&](int lane) {
        return bent.u[LAST][lane] * end.u + bent.v[LAST][lane] * end.v + rig.tip_offset_m * end.per_m;
    };
    const double* available = frame.available;
    double base[3];
    for (int about = 0; about < 2; ++about) {
        base[about] = predicted_moment(rig, frame, bent, 0, about);
        fit.predicted_residual[about] = (frame.moment_Nm[about] / rig.std[about] - base[about]) * available[about];
    }
    base[2] = tip_of(0);
    fit.predicted_residual[2] = (frame.tip[0] * end.u + frame.tip[1] * end.v - base[2]) * available[2];
    for (int axis = 0; axis < 3; ++axis) {
        fit.point_force[axis] = bent.points_m[axis][CONTACT][0];
        fit.point_force[3 + axis] = bent.force_N[axis][0];
    }
    for (int k = 0; k < free; ++k) {
        const double by_step = 1.0 / (k == 0 ? back : STEP);
        bent.by_step[1 + k] = by_step;
        for (int about = 0; about < 2; ++about) {
            const double change = predicted_moment(rig, frame, bent, k + 1, about) - base[about];
            fit.reading_columns(about, k) = change * by_step * available[about];
        }
        fit.reading_columns(2, k) = (tip_of(k + 1) - base[2]) * by_step * available[2];
        for (int axis = 0; axis < 3; ++axis) {
            const auto &point = bent.points_m[axis][CONTACT], &force = bent.force_N[axis];
            fit.point_force_columns(axis, k) = (point[k + 1] - point[0]) * by_step;
            fit.point_force_columns(3 + axis, k) = (force[k + 1] - force[0]) * by_step;
        }
    }
    if (free) by_unknowns(bent, fit, free);
    if (free == UNKNOWNS - 1) friction_column(rig, fit);
}

}  // namespace vbaa::solver
