#include "solver/rig_jacobian.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "lens.hpp"
#include "linear_algebra.hpp"
#include "solver/prediction.hpp"

namespace vbaa::solver {

namespace {

constexpr int PLACE = 2;                 // of the antenna's parameters the first ones are the clamp's place, y and z
constexpr int BASE = LANES - 1;          // the lane of the antenna as it is
constexpr int SENSOR = POSES + ANTENNA;  // where these parameters of the rig begin
constexpr double OF_UNKNOWNS[LANES] = {1.0, 1.0, 1.0, 1.0};  // the columns of a fit before the axes
static_assert(ANTENNA - PLACE <= BASE && UNKNOWNS == 4);

// The row of a sample among the raw derivatives.
int row_of(int node) { return node / NODES * Samples::count + node % NODES / Samples::every; }

// Calls work(node, row) for the samples of all pictures.
template <class Work>
void at_samples(const Fit& fit, Work&& work) {
    for (int clamp = 0, row = 0; clamp < fit.nodes; clamp += NODES) {
        for (int j = clamp; j < clamp + NODES; j += Samples::every) work(j, row++);
    }
}

// Raw derivatives by a camera's pose's tangent, of the fit's points in its picture from the clamp's node on.
void by_pose(const Rig& rig, int clamp, const Frame& frame, Bent& bent, const Fit& fit, const TipAxis& end) {
    const Camera& camera = rig.cameras[clamp / NODES];
    const Lanes by_step = load(rig.by_pose_step);
    for (int sample = 0; sample < Samples::count; ++sample) {
        const int k = sample * Samples::every, j = clamp + k;
        const double x = fit.points_m[0][k], y = fit.points_m[1][k], z = fit.points_m[2][k];
        const auto seen = [&](int axis) {
            const auto& pose = camera.pose_lanes[axis];
            return x * load(pose[0]) + y * load(pose[1]) + z * load(pose[2]) + load(pose[3]);
        };
        Lanes ahead = seen(2);
        ahead = where_positive(NEAREST_DEPTH_M - ahead, NEAREST_DEPTH_M, ahead);
        const Lanes by_depth = 1.0 / ahead;
        const Lanes u = (seen(0) * by_depth - fit.u[j]) * by_step, v = (seen(1) * by_depth - fit.v[j]) * by_step;
        store(&bent.raw(row_of(j), camera.pose_at), u * fit.normal_u[j] + v * fit.normal_v[j]);
        if (j == frame.tip_clamp + LAST) store(&bent.raw_readings(END, camera.pose_at), u * end.u + v * end.v);
    }
}

// Raw derivatives by all of the antenna's parameters except its place, each in a lane next to that of the unchanged
// antenna. Returns the wrench on the unchanged antenna.
ClampWrench by_antenna(const Rig& rig, const Frame& frame, int rung, Bent& bent, const Fit& fit, const TipAxis& end) {
    constexpr int count = ANTENNA - PLACE, first = POSES + PLACE;
    lay(rig, bent, fit.unknowns);
    bent.by_step[BASE] = 0.0;
    for (int lane = 0; lane < count; ++lane) {
        bent.parameters[PLACE + lane][lane] += rig.antenna_steps[PLACE + lane];
        bent.by_step[lane] = 1.0 / rig.antenna_steps[PLACE + lane];
    }
    bend_and_see(rig, frame, rung, bent, false);
    const Lanes by_step = load(bent.by_step);
    const ClampWrench base = clamp_wrench(rig, frame, bent, BASE);
    const auto change = [&](const double* values) { return load(values) - values[BASE]; };
    at_samples(fit, [&](int j, int row) {
        const Lanes u = change(&bent.u(j, 0)) * (by_step * fit.normal_u[j]);
        store(&bent.raw(row, first), u + change(&bent.v(j, 0)) * (by_step * fit.normal_v[j]));
    });
    const int tip = frame.tip_clamp + LAST;
    store(&bent.raw_readings(END, first),
          (change(&bent.u(tip, 0)) * end.u + change(&bent.v(tip, 0)) * end.v) * by_step);
    for (int lane = 0; lane < count; ++lane) {
        ClampWrench moved = clamp_wrench(rig, frame, bent, lane);
        for (int k = 0; k < WRENCH; ++k) moved.values[k] = (moved.values[k] - base.values[k]) * bent.by_step[lane];
        for (int reading = 0; reading < rig.readings; ++reading) {
            if (reading != END) bent.raw_readings(reading, first + lane) = read_by(rig.by_wrench[reading], moved);
        }
    }
    for (int axis = 0; axis < 3; ++axis) {
        store(&bent.raw_point_force(axis, first), change(bent.points_m[axis][CONTACT]) * by_step);
        store(&bent.raw_point_force(3 + axis, first), change(bent.force_N[axis]) * by_step);
    }
    return base;
}

// Raw derivatives by the clamp's place across the antenna frame's x axis, with which the whole antenna moves.
void by_place(const Rig& rig, const Frame& frame, int rung, const ClampWrench& wrench, Bent& bent, const Fit& fit) {
    const TipAxis end = fitted_tip_axis(rig, frame, fit);
    const auto& turn = rig.cameras[frame.tip_clamp / NODES].rotation;
    const int tip = frame.tip_clamp + LAST;
    const Array<double, 2> image = point_jacobian(rig, fit);
    const double pull = bent.force_N[0][BASE];
    const double weight = std::exp(rig.antenna_parameters[7]) * rig.taper.weight * rig.length_m * frame.gravity_m_s2[0];
    // small deflections: only friction's part of the pull has a moment about the clamp's place
    double lever = pull;
    if (rung < ELASTICA) {
        lever = -std::hypot(bent.push_N[0][BASE], bent.push_N[1][BASE]) * std::tan(bent.friction_rad[BASE]);
    }
    for (int k = 0; k < PLACE; ++k) {
        const int column = POSES + k;
        at_samples(fit, [&](int j, int row) { bent.raw(row, column) = image(k, j); });
        const double ahead = (end.u * fit.u[tip] + end.v * fit.v[tip]) * turn[2][1 + k];
        bent.raw_readings(END, column) = (end.u * turn[0][1 + k] + end.v * turn[1][1 + k] - ahead) / fit.depth[tip];
        for (int q = 0; q < 6; ++q) bent.raw_point_force(q, column) = q == 1 + k ? 1.0 : 0.0;
    }
    const double *force = wrench.values, about_z = rig.with_wrench ? -(pull + weight) : 0.0;
    const ClampWrench moved[PLACE] = {{{0.0, 0.0, 0.0, force[2], 0.0, about_z, 0.0}},
                                      {{0.0, 0.0, 0.0, -force[1], lever + weight, 0.0, 0.0}}};
    for (int reading = 0; reading < rig.readings; ++reading) {
        if (reading == END) continue;
        for (int k = 0; k < PLACE; ++k) {
            bent.raw_readings(reading, POSES + k) = read_by(rig.by_wrench[reading], moved[k]);
        }
    }
}

// Raw derivatives of the readings, in σ, by the sensor's parameters.
void by_sensor(const Rig& rig, const ClampWrench& wrench, Bent& bent) {
    for (int k = 0; k < rig.by_sensor.shape[0]; ++k) {
        const int column = k < OF_MOMENT ? SENSOR + k : rig.more_at + k - OF_MOMENT;
        for (int reading = 0; reading < rig.readings; ++reading) {
            double change = 0.0;
            for (int c = 0; c < WRENCH; ++c) change += rig.by_sensor(k, reading, c) * wrench.values[c];
            bent.raw_readings(reading, column) = change;
        }
    }
}

// Raw derivatives by a camera's lens, which moves the points seen in its picture, not the curve.
void by_lens(const Camera& camera, int clamp, const Frame& frame, Bent& bent, const Fit& fit, const TipAxis& end) {
    const int count = camera.lens->parameters();
    for (int begin = 0; begin < Samples::count; begin += LANES) {
        const int some = std::min(LANES, Samples::count - begin);
        for (int lane = 0; lane < LANES; ++lane) {
            const int j = clamp + (begin + std::min(lane, some - 1)) * Samples::every;
            bent.seen[0][lane] = fit.u[j], bent.seen[1][lane] = fit.v[j];
        }
        lens::normalized_by_lens(*camera.lens, bent.seen, view(bent.by_lens));
        for (int lane = 0; lane < some; ++lane) {
            const int j = clamp + (begin + lane) * Samples::every;
            for (int k = 0; k < count; ++k) {
                const double u = bent.by_lens[0][k][lane], v = bent.by_lens[1][k][lane];
                bent.raw(row_of(j), camera.lens_at + k) = -(fit.normal_u[j] * u + fit.normal_v[j] * v);
            }
        }
    }
    if (clamp != frame.tip_clamp) return;
    constexpr int last = (Samples::count - 1) % LANES;
    for (int k = 0; k < count; ++k) {
        bent.raw_readings(END, camera.lens_at + k) =
            -(end.u * bent.by_lens[0][k][last] + end.v * bent.by_lens[1][k][last]);
    }
}

// A range of the rig's parameters, without its end.
struct Range {
    int begin, end;
};

// Three rows of derivatives by parameters in two ranges along the axes in COUNT vectors of columns, into every n-th
// row.
template <int COUNT>
void three_along_axes(ConstMatrix axes, ConstMatrix raw, const Range (&ranges)[2], int first, Matrix columns,
                      int every) {
    Lanes sums[3][COUNT];
    for (auto& sums_of_row : sums) {
        for (Lanes& sum : sums_of_row) sum = spread(0.0);
    }
    const int wide = axes.shape[1], apart = raw.shape[1];
    const double* parts = raw.data;
    for (const Range& range : ranges) {
        const double* axis = axes.data + range.begin * wide + first;
        for (int q = range.begin; q < range.end; ++q, axis += wide) {
            for (int c = 0; c < COUNT; ++c) {
                const Lanes along = load(axis + c * LANES);
                for (int r = 0; r < 3; ++r) sums[r][c] += parts[r * apart + q] * along;
            }
        }
    }
    for (int r = 0; r < 3; ++r) {
        double* to = &columns(every * r, first);
        if (first == 0) sums[r][0] = where_positive(load(OF_UNKNOWNS), load(to), sums[r][0]);
        for (int c = 0; c < COUNT; ++c) store(to + c * LANES, sums[r][c]);
    }
}

// Derivatives (M, Q) by the rig's parameters in two ranges along the axes (Q, K′), into every n-th row of some vectors
// of columns, or so many; those of the unknowns stay.
template <class Vectors>
void along_axes(ConstMatrix axes, ConstMatrix raw, const Range (&ranges)[2], const Vectors& vectors, Matrix columns,
                int every) {
    static_assert(Samples::count % 3 == 0);
    for (int row = 0; row < raw.shape[0]; row += 3) {
        const ConstMatrix some = raw.part(row, 3);
        const Matrix to = columns.part(row * every, 2 * every + 1);
        by_vectors(vectors,
                   [&](auto count, int first) { three_along_axes<count>(axes, some, ranges, first, to, every); });
    }
}

// The same for the points of all pictures, each by the parameters that its camera depends on.
void pictures_along_axes(const Rig& rig, const Bent& bent, Fit& fit) {
    const int parameters = rig.axes.shape[0];
    int clamp = 0;
    for (const Camera& camera : rig.cameras) {
        const int end = camera.lens_at + (rig.with_lens ? camera.lens->parameters() : 0);
        Range ranges[2] = {{POSES, SENSOR}, {camera.pose_at, end}};
        if (clamp == 0) ranges[0] = {0, rig.cameras.size() > 1 ? end : parameters}, ranges[1] = {};
        const Matrix columns = fit.columns.view().part(clamp, NODES);
        along_axes(bent.axes, ConstMatrix(bent.raw).part(row_of(clamp), Samples::count), ranges, camera.vectors,
                   columns, Samples::every);
        fill_between_samples(camera.vectors, UNKNOWNS, columns);
        clamp += NODES;
    }
}

// The found line's own errors, which readings and contact do not have: the first Legendre polynomials along the
// antenna.
void by_line(const Rig& rig, Fit& fit) {
    const int count = rig.cameras[0].line.size(), first = UNKNOWNS + rig.shared;
    double along[NODES], shape[NODES], lower[NODES] = {};
    for (int j = 0; j < NODES; ++j) {
        along[j] = 2.0 * arclength_of_node(fit, rig.length_m, j) * (1.0 / rig.length_m) - 1.0;
        shape[j] = 1.0;
    }
    if (rig.cameras.size() > 1) {
        for (int j = 0; j < fit.nodes; ++j) std::fill_n(&fit.columns(j, first), rig.lines(), 0.0);
    }
    for (int k = 0; k < count; ++k) {
        int clamp = 0;
        for (const Camera& camera : rig.cameras) {
            double* column = &fit.columns(clamp, first + clamp / NODES * count + k);
            for (int j = 0; j < NODES; ++j) column[j * fit.columns.shape[1]] = shape[j] * camera.line[k];
            clamp += NODES;
        }
        const double rise = (2.0 * k + 1.0) / (k + 1.0), fall = k / (k + 1.0);
        for (int j = 0; j < NODES; ++j) {
            const double higher = rise * along[j] * shape[j] - fall * lower[j];
            lower[j] = std::exchange(shape[j], higher);
        }
    }
    for (int reading = 0; reading < rig.readings; ++reading) {
        std::fill_n(&fit.reading_columns(reading, first), rig.lines(), 0.0);
    }
    for (int q = 0; q < 6; ++q) std::fill_n(&fit.point_force_columns(q, first), rig.lines(), 0.0);
}

// The first of four samples around each node, and their weights there, either side of the contact by itself.
struct Between {
    int first[NODES] = {};
    double weights[NODES][4] = {};
};

constexpr Between between_samples() {
    Between found;
    for (int j = 0; j < NODES; ++j) {
        const bool inner = j < CONTACT;
        const int least = inner ? 0 : CONTACT / Samples::every,
                  last = inner ? CONTACT / Samples::every : Samples::count - 1;
        const int first = std::min(std::max(j / Samples::every - 1, least), last - 3);
        found.first[j] = first * Samples::every;
        for (int k = 0; k < 4; ++k) {
            found.weights[j][k] = 1.0;
            for (int other = 0; other < 4; ++other) {
                if (other != k) found.weights[j][k] *= (double(j) / Samples::every - first - other) / (k - other);
            }
        }
    }
    return found;
}

}  // namespace

void fill_between_samples(const std::vector<int>& vectors, int kept, Matrix rows) {
    static constexpr Between at = between_samples();
    double first[LANES];
    for (int j = 0; j < NODES; ++j) {
        if (j % Samples::every == 0) continue;
        std::copy_n(&rows(j, 0), LANES, first);
        for (int each : vectors) {
            Lanes total = spread(0.0);
            for (int k = 0; k < 4; ++k) {
                total += at.weights[j][k] * load(&rows(at.first[j] + k * Samples::every, each * LANES));
            }
            store(&rows(j, each * LANES), total);
        }
        std::copy_n(first, kept, &rows(j, 0));
    }
}

void rig_derivatives(const Rig& rig, const Frame& frame, int rung, Bent& bent, const Fit& fit) {
    rung = std::max<int>(rung, LINEAR);
    const TipAxis end = fitted_tip_axis(rig, frame, fit);
    // each writes whole vectors; the next one overwrites their ends
    int clamp = 0;
    if (rig.cameras.size() > 1) fill(bent.raw_readings.row(END), 0.0);
    for (const Camera& camera : rig.cameras) {
        by_pose(rig, clamp, frame, bent, fit, end);
        if (rig.with_lens) by_lens(camera, clamp, frame, bent, fit, end);
        clamp += NODES;
    }
    const ClampWrench wrench = by_antenna(rig, frame, rung, bent, fit, end);
    by_place(rig, frame, rung, wrench, bent, fit);
    if (rig.with_tip) bent.raw_readings(END, rig.tip_at) = end.per_m;
    by_sensor(rig, wrench, bent);
}

void rig_jacobian(const Rig& rig, const Frame& frame, int rung, Bent& bent, Fit& fit) {
    if (rig.steps() == 0) return;
    rig_derivatives(rig, frame, rung, bent, fit);
    pictures_along_axes(rig, bent, fit);
    const Range every[2] = {{0, rig.axes.shape[0]}, {}};
    const int wide = bent.axes.shape[1];
    along_axes(bent.axes, bent.raw_readings, every, wide, fit.reading_columns, 1);
    along_axes(bent.axes, bent.raw_point_force, every, wide, fit.point_force_columns, 1);
    for (int reading = 0; reading < rig.readings; ++reading) {
        for (int k = 0; k < rig.shared; ++k) fit.reading_columns(reading, UNKNOWNS + k) *= frame.available[reading];
    }
    by_line(rig, fit);
}

}  // namespace vbaa::solver
