#include "solver/gradients.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "linear_algebra.hpp"
#include "solver/normal_equations.hpp"
#include "solver/prediction.hpp"
#include "solver/rig_jacobian.hpp"

namespace vbaa::solver {
namespace {

constexpr int ROUNDS = 8;              // of the rig's steps at a known contact
constexpr double GRAVITY_STEP = 1e-2;  // m/s²
static_assert(RESULTS <= LANES);

// Derivatives of the prediction by C quantities: along the normals (M, C′), of readings in σ (READINGS, C′), of
// contact point and force (6, C′), C′ being C rounded up to whole vectors.
struct Changes {
    Array<double, 2> shift, reading, touch;

    Changes(int nodes, int count)
        : shift(nodes, whole_lanes(count)), reading(READINGS, whole_lanes(count)), touch(6, whole_lanes(count)) {}
};

// The rig's likeliest steps at the fit's unknowns; what lies in the flat part of the Huber loss gets no weight.
void solve_rig_steps(const Rig& rig, const Frame& frame, Fit& fit, Work& work) {
    nearest_feet(rig, frame, fit);
    linearise(rig, frame, fit, work);
    if (rig.steps() > 0) least_cost(rig, fit, UNKNOWNS, ROUNDS, work);
    for (int i = 0; i < fit.points; ++i) {
        if (std::abs(fit.distance[i]) * std::sqrt(fit.precision[i]) > HUBER * fit.scatter) fit.precision[i] = 0.0;
    }
    for (int reading = 0; reading < fit.readings; ++reading) {
        if (std::abs(fit.residual[reading]) <= HUBER) continue;
        std::fill_n(fit.reading_columns.row(reading).data, fit.reading_columns.shape[1], 0.0);
    }
    normal_equations(rig, fit, 0, work.product);
}

// Derivatives of the results by the right side of the normal equations, (K, LANES).
Array<double, 2> responses(const Rig& rig, const Fit& fit, bool at_tip, Work& work) {
    const int first = at_tip ? 1 : 0, size = fit.size - first;
    Array<double, 2> sides(size, LANES), found(fit.size, LANES);
    if (!at_tip) sides(0, 0) = rig.length_m;
    for (int a = 0; a < size; ++a) {
        for (int q = 0; q < 6; ++q) sides(a, 1 + q) = fit.point_force_columns(q, first + a);
    }
    factorise(fit.information, first, size, 0.0, work.factor, work.scale);
    solve_many(work.factor, work.scale, size, sides, true);
    for (int a = 0; a < size; ++a) std::copy_n(sides.row(a).data, LANES, found.row(first + a).data);
    return found;
}

// Derivatives (7, C) of the results by quantities, from the prediction's derivatives by these.
void by_changes(const Fit& fit, ConstMatrix response, const Changes& changes, Matrix found) {
    Array<double, 2> weighted(fit.nodes, changes.shift.shape[1]);
    times_tridiagonal(fit, changes.shift, weighted);
    for (int c = 0; c < found.shape[1]; ++c) {
        Lanes total = {};
        for (int a = 0; a < fit.size; ++a) {
            double pull = 0.0;
            for (int j = 0; j < fit.nodes; ++j) pull += fit.columns(j, a) * weighted(j, c);
            for (int k = 0; k < fit.readings; ++k) pull += fit.reading_columns(k, a) * changes.reading(k, c);
            total -= pull * load(response.row(a).data);
        }
        for (int q = 0; q < RESULTS; ++q) found(q, c) = total[q] + (q > 0 ? changes.touch(q - 1, c) : 0.0);
    }
}

// Derivatives by the ideal points (7, N, 2), zeros for missing ones.
void by_points(const Fit& fit, ConstMatrix response, ConstVector usable, Cube found) {
    Array<double, 2> along(fit.nodes, LANES);
    for (int j = 0; j < fit.nodes; ++j) {
        Lanes total = {};
        for (int a = 0; a < fit.size; ++a) total += fit.columns(j, a) * load(response.row(a).data);
        store(&along(j, 0), total);
    }
    const double by_scatter = 1.0 / (fit.scatter * fit.scatter);
    int i = 0;
    for (int row = 0; row < usable.size(); ++row) {
        for (int q = 0; q < RESULTS; ++q) found(q, row, 0) = found(q, row, 1) = 0.0;
        if (!(usable[row] > 0.0)) continue;
        const int node = fit.node[i];
        const double share = fit.share[i], weight = fit.precision[i] * by_scatter;
        const double u = fit.normal_u[node] + share * (fit.normal_u[node + 1] - fit.normal_u[node]);
        const double v = fit.normal_v[node] + share * (fit.normal_v[node + 1] - fit.normal_v[node]);
        const double scale = weight / std::hypot(u, v);
        for (int q = 0; q < RESULTS; ++q) {
            const double pull = (along(node, q) + share * (along(node + 1, q) - along(node, q))) * scale;
            found(q, row, 0) = pull * u;
            found(q, row, 1) = pull * v;
        }
        ++i;
    }
}

// Derivatives of the prediction by the rig's parameters.
Changes changes_by_rig(const Rig& rig, const Frame& frame, const Bent& bent) {
    const int count = rig.axes.shape[0];
    Changes changes(rig.nodes(), count);
    std::vector<int> vectors(changes.shift.shape[1] / LANES);
    std::iota(vectors.begin(), vectors.end(), 0);
    for (int row = 0; row < rig.samples(); ++row) {
        const int j = row / Samples::count * NODES + row % Samples::count * Samples::every;
        std::copy_n(bent.raw.row(row).data, count, changes.shift.row(j).data);
    }
    for (int clamp = 0; clamp < rig.nodes(); clamp += NODES) {
        fill_between_samples(vectors, 0, changes.shift.view().part(clamp, NODES));
    }
    for (int k = 0; k < rig.readings; ++k) {
        for (int q = 0; q < count; ++q) changes.reading(k, q) = bent.raw_readings(k, q) * frame.available[k];
    }
    for (int k = 0; k < 6; ++k) std::copy_n(bent.raw_point_force.row(k).data, count, changes.touch.row(k).data);
    return changes;
}

// Derivatives of the prediction by gravity along each axis of the antenna frame.
Changes changes_by_gravity(const Rig& rig, const Frame& frame, int rung, const Fit& fit, Bent& bent) {
    Changes changes(fit.nodes, 3);
    const TipAxis end = fitted_tip_axis(rig, frame, fit);
    Frame moved = frame;
    for (int axis = 0; axis < 3; ++axis) {
        for (const double sign : {1.0, -1.0}) {
            const double scale = sign / (2.0 * GRAVITY_STEP);
            moved.gravity_m_s2[axis] = frame.gravity_m_s2[axis] + sign * GRAVITY_STEP;
            lay(rig, bent, fit.unknowns);
            bend_and_see(rig, moved, rung, bent, false);
            for (int j = 0; j < fit.nodes; ++j) {
                const double u = bent.u(j, 0) - fit.u[j], v = bent.v(j, 0) - fit.v[j];
                changes.shift(j, axis) += scale * (u * fit.normal_u[j] + v * fit.normal_v[j]);
            }
            const ClampWrench wrench = clamp_wrench(rig, moved, bent, 0);
            for (int k = 0; k < rig.readings; ++k) {
                if (k != END)
                    changes.reading(k, axis) += scale * read_by(rig.by_wrench[k], wrench) * frame.available[k];
            }
            const int tip = frame.tip_clamp + LAST;
            const double u = bent.u(tip, 0) - fit.u[tip], v = bent.v(tip, 0) - fit.v[tip];
            changes.reading(END, axis) += scale * (u * end.u + v * end.v) * frame.available[END];
            for (int k = 0; k < 3; ++k) {
                changes.touch(k, axis) += scale * bent.points_m[k][CONTACT][0];
                changes.touch(3 + k, axis) += scale * bent.force_N[k][0];
            }
        }
        moved.gravity_m_s2[axis] = frame.gravity_m_s2[axis];
    }
    return changes;
}

}  // namespace

void gradients(const Rig& rig, const Frames& frames, const Minima& minima, const Gradients& found) {
    const auto& [rung, unknowns, scatter, at_tip] = minima;
    for (int index = 0; index < frames.size(); ++index) {
        const Frame frame = frame_of(rig, frames, index);
        Work work(rig, frame.count);
        Fit& fit = work.best;
        std::copy_n(unknowns.row(index).data, UNKNOWNS, fit.unknowns.begin());
        fit.scatter = scatter[index];
        predict(rig, frame, rung, work.bent, fit, true);
        rig_jacobian(rig, frame, rung, work.bent, fit);
        if (rig.steps() == 0) rig_derivatives(rig, frame, rung, work.bent, fit);
        const Changes by_rig = changes_by_rig(rig, frame, work.bent);
        const Changes by_gravity = changes_by_gravity(rig, frame, rung, fit, work.bent);
        solve_rig_steps(rig, frame, fit, work);
        const Array<double, 2> response = responses(rig, fit, at_tip[index], work);
        by_changes(fit, response, by_rig, found.by_rig.row(index));
        by_changes(fit, response, by_gravity, found.by_gravity.row(index));
        by_points(fit, response, frames.usable.row(index), found.by_points.row(index));
        for (int k = 0; k < rig.readings; ++k) {
            Lanes total = {};
            for (int a = 0; a < fit.size; ++a) total += fit.reading_columns(k, a) * load(response.row(a).data);
            const double scale = k == END ? 0.0 : frame.available[k] / rig.std[k];
            for (int q = 0; q < RESULTS; ++q) found.by_readings(index, q, k) = total[q] * scale;
        }
    }
}

}  // namespace vbaa::solver
