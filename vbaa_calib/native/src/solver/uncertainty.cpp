#include "solver/uncertainty.hpp"

#include <algorithm>
#include <cmath>

#include "linear_algebra.hpp"
#include "solver/convergence.hpp"
#include "solver/normal_equations.hpp"
#include "solver/prediction.hpp"

namespace vbaa::solver {
namespace {

// IRLS rounds of a linear problem: far from the solution, and next to it.
constexpr int ROUNDS = 4, CLOSE_ROUNDS = 2;
// Least σ of a moment's residual in its own σ: with less the moment was fitted, not tested.
constexpr double LEAST_REDUNDANCY = 0.03;
// Standard deviations from the minimum at which the cost is profiled.
constexpr double PROFILE_STEPS[] = {3.0, 6.0, -3.0, -6.0};
// Evidence of a contact above which the fit's own cost is taken as it is.
constexpr double BEYOND_DOUBT = 100.0;
// Condition number of the scaled information beyond which the covariance is infinite.
constexpr double SINGULAR = 1e14;

// Changes of what is observed and found: along the normals (M, ·), of the readings in σ (READINGS, ·), of contact point
// and force (6, ·); a column for each row of Errors. sign : of the difference between another shape and the fit.
struct Changes {
    double sign;
    Array<double, 2> shift;
    double reading[READINGS][LANES] = {}, touch[6][LANES] = {};

    Changes(double way, int nodes) : sign(way), shift(nodes, LANES) {}
};

// The rig's part of the uncertainty: covariance of its steps for a known contact, and their dependence on the contact.
// Returns its part of the readings' variances.
std::array<double, READINGS> rig_part(const Fit& fit, Uncertainty& found, Work& work) {
    const int steps = fit.size - UNKNOWNS;
    std::array<double, READINGS> fitted = {};
    Array<double, 2> sides(steps, whole_lanes(UNKNOWNS + 6 + fit.readings));
    for (int k = 0; k < steps; ++k) {
        for (int a = 0; a < UNKNOWNS; ++a) sides(k, a) = -fit.information(UNKNOWNS + k, a);
        for (int q = 0; q < 6; ++q) sides(k, UNKNOWNS + q) = fit.point_force_columns(q, UNKNOWNS + k);
        for (int reading = 0; reading < fit.readings; ++reading) {
            sides(k, UNKNOWNS + 6 + reading) = fit.reading_columns(reading, UNKNOWNS + k);
        }
    }
    factorise(fit.information, UNKNOWNS, steps, 0.0, work.factor, work.scale);
    solve_many(work.factor, work.scale, steps, sides, true);
    for (int p = 0; p < 6; ++p) {
        for (int a = 0; a < UNKNOWNS; ++a) found.touch[p][a] = fit.point_force_columns(p, a);
        std::fill_n(found.touch_by_rig[p], 6, 0.0);
    }
    for (int k = 0; k < steps; ++k) {
        for (int a = 0; a < UNKNOWNS; ++a) found.rig_response(k, a) = sides(k, a);
        for (int reading = 0; reading < fit.readings; ++reading) {
            fitted[reading] += fit.reading_columns(reading, UNKNOWNS + k) * sides(k, UNKNOWNS + 6 + reading);
        }
        for (int p = 0; p < 6; ++p) {
            const double column = fit.point_force_columns(p, UNKNOWNS + k);
            found.rig_touch(k, p) = sides(k, UNKNOWNS + p);
            for (int a = 0; a < UNKNOWNS; ++a) found.touch[p][a] += column * sides(k, a);
            for (int q = 0; q < 6; ++q) found.touch_by_rig[p][q] += column * sides(k, UNKNOWNS + q);
        }
    }
    return fitted;
}

// σ of each reading's residual, reduced by the part that was fitted; `fitted` is the rig's share of that part.
void reading_std(const Fit& fit, const std::array<double, READINGS>& fitted, Uncertainty& found) {
    for (int reading = 0; reading < fit.readings; ++reading) {
        double total[UNKNOWNS], own = fitted[reading];
        for (int a = 0; a < UNKNOWNS; ++a) {
            total[a] = fit.reading_columns(reading, a);
            for (int k = 0; k < fit.size - UNKNOWNS; ++k) {
                total[a] += fit.reading_columns(reading, UNKNOWNS + k) * found.rig_response(k, a);
            }
        }
        for (int a = 0; a < UNKNOWNS; ++a) {
            for (int b = 0; b < UNKNOWNS; ++b) own += total[a] * found.covariance[a][b] * total[b];
        }
        const double left = 1.0 - huber_weight(fit.residual[reading]) * own;
        found.reading_std[reading] = std::sqrt(std::max(left, LEAST_REDUNDANCY * LEAST_REDUNDANCY));
    }
}

// Difference between the predictions of another shape of the antenna and the fit's, into a column.
void compare(const Rig& rig, const Frame& frame, const Fit& fit, const Bent& bent, int column, Changes& changes) {
    const double sign = changes.sign;
    for (int j = 0; j < fit.nodes; ++j) {
        const double u = bent.u(j, 0) - fit.u[j], v = bent.v(j, 0) - fit.v[j];
        changes.shift(j, column) = sign * (u * fit.normal_u[j] + v * fit.normal_v[j]);
    }
    const ClampWrench wrench = clamp_wrench(rig, frame, bent, 0);
    for (int k = 0; k < rig.readings; ++k) {
        const double apart = read_by(rig.by_wrench[k], wrench) - frame.reading[k] / rig.std[k];
        changes.reading[k][column] = sign * (apart * frame.available[k] + fit.predicted_residual[k]);
    }
    const TipAxis end = fitted_tip_axis(rig, frame, fit);
    const int tip = frame.tip_clamp + LAST;
    const double along = (bent.u(tip, 0) - fit.u[tip]) * end.u + (bent.v(tip, 0) - fit.v[tip]) * end.v;
    changes.reading[END][column] = sign * along * frame.available[END];
    for (int axis = 0; axis < 3; ++axis) {
        changes.touch[axis][column] = sign * (bent.points_m[axis][CONTACT][0] - fit.point_force[axis]);
        changes.touch[3 + axis][column] = sign * (bent.force_N[axis][0] - fit.point_force[3 + axis]);
    }
}

// How far unknowns and rig steps (K, LANES) would move, to first order, if the data changed.
Array<double, 2> linear_shifts(const Fit& fit, const Changes& changes, Work& work) {
    Array<double, 2> product(fit.nodes, LANES), sides(fit.size, LANES);
    times_tridiagonal(fit, changes.shift, product);
    for (int a = 0; a < fit.size; ++a) {
        Lanes total = {};
        for (int j = 0; j < fit.nodes; ++j) total += fit.columns(j, a) * load(&product(j, 0));
        for (int k = 0; k < fit.readings; ++k) {
            total += huber_weight(fit.residual[k]) * fit.reading_columns(k, a) * load(changes.reading[k]);
        }
        store(sides.row(a).data, total);
    }
    factorise(fit.information, 0, fit.size, 0.0, work.factor, work.scale);
    solve_many(work.factor, work.scale, fit.size, sides, true);
    return sides;
}

// The changes that other rungs' shapes, or friction, would make at the fit's unknowns.
Changes changes_by_shape(const Rig& rig, const Frame& frame, int rung, const Fit& fit, const Fit& reference,
                         Bent& bent) {
    Changes changes(rung == REFERENCE ? -1.0 : 1.0, fit.nodes);
    lay(rig, bent, fit.unknowns);
    if (rung == REFERENCE) {
        for (int lower = 0; lower < REFERENCE; ++lower) {
            bend_and_see(rig, frame, lower, bent, false);
            compare(rig, frame, fit, bent, lower, changes);
        }
        if (!(rig.friction_rad > 0.0)) return changes;
        constexpr int FRICTION = UNKNOWNS - 1;
        for (int j = 0; j < fit.nodes; ++j) changes.shift(j, BY_FRICTION) = fit.columns(j, FRICTION);
        for (int k = 0; k < fit.readings; ++k) changes.reading[k][BY_FRICTION] = fit.reading_columns(k, FRICTION);
        for (int q = 0; q < 6; ++q) changes.touch[q][BY_FRICTION] = fit.point_force_columns(q, FRICTION);
        return changes;
    }
    bend_and_see(rig, frame, REFERENCE, bent, false);
    compare(rig, frame, fit, bent, rung, changes);
    if (rung < ELASTICA && rig.friction_rad > 0.0) {
        store(bent.friction_rad, spread((fit.unknowns[UNKNOWNS - 1] + 1.0) * rig.friction_rad));
        bend_and_see(rig, frame, REFERENCE, bent, false);
        compare(rig, frame, reference, bent, BY_FRICTION, changes);
    }
    return changes;
}

}  // namespace

void uncertainty(const Fit& fit, Uncertainty& found, Work& work) {
    const std::array<double, READINGS> fitted = rig_part(fit, found, work);
    double own[UNKNOWNS][UNKNOWNS], scale[UNKNOWNS], values[UNKNOWNS], vectors[UNKNOWNS][UNKNOWNS];
    bool regular = true;
    for (int a = 0; a < UNKNOWNS; ++a) {
        for (int b = 0; b < UNKNOWNS; ++b) {
            own[a][b] = fit.information(a, b);
            for (int k = UNKNOWNS; k < fit.size; ++k)
                own[a][b] += fit.information(a, k) * found.rig_response(k - UNKNOWNS, b);
            regular = regular && std::isfinite(own[a][b]);
        }
    }
    for (int a = 0; a < UNKNOWNS; ++a) regular = regular && own[a][a] > 0.0;
    std::fill_n(found.covariance[0], UNKNOWNS * UNKNOWNS, INFINITE);
    std::fill_n(found.reading_std, READINGS, 1.0);
    found.condition = INFINITE;
    if (!regular) return;
    for (int a = 0; a < UNKNOWNS; ++a) scale[a] = 1.0 / std::sqrt(own[a][a]);
    for (int a = 0; a < UNKNOWNS; ++a) {
        for (int b = 0; b < UNKNOWNS; ++b) own[a][b] *= scale[a] * scale[b];
    }
    symmetric_eigen(own, values, vectors);
    if (!(values[0] > values[UNKNOWNS - 1] / SINGULAR)) return;
    for (int a = 0; a < UNKNOWNS; ++a) {
        for (int b = 0; b < UNKNOWNS; ++b) {
            double total = 0.0;
            for (int k = 0; k < UNKNOWNS; ++k) total += vectors[a][k] * vectors[b][k] / values[k];
            found.covariance[a][b] = total * scale[a] * scale[b];
        }
    }
    found.condition = values[UNKNOWNS - 1] / values[0];
    reading_std(fit, fitted, found);
    const double inflation = huber_variance_inflation(fit);
    for (double& each : view(found.covariance)) each *= inflation;
    if (!fit.at_tip) return;
    // the contact may also be where the fit with a free distance has it
    for (int a = 0; a < UNKNOWNS; ++a) {
        for (int b = 0; b < UNKNOWNS; ++b) found.covariance[a][b] += fit.to_tip[a] * fit.to_tip[b];
    }
}

double huber_excess(const Fit& fit) {
    const double by_scatter = 1.0 / fit.scatter;
    double square = 0.0, total = 0.0;
    for (int i = 0; i < fit.points; ++i) {
        const double whitened = std::abs(fit.distance[i]) * std::sqrt(fit.precision[i]) * by_scatter;
        const double weight = HUBER / std::max(whitened, HUBER);
        square += weight * whitened * weight * whitened;
        total += weight;
    }
    return square / std::max(total, 1e-30);
}

double huber_variance_inflation(const Fit& fit) {
    const double factor = huber_excess(fit);
    return factor > 1.0 + EXCESS_SCATTER / std::sqrt(fit.points + 1e-30) ? factor : 1.0;
}

void touch_covariance(const Uncertainty& found, double (&total)[6][6]) {
    for (int p = 0; p < 6; ++p) {
        for (int q = 0; q < 6; ++q) {
            double value = found.touch_by_rig[p][q];
            for (int a = 0; a < UNKNOWNS; ++a) {
                for (int b = 0; b < UNKNOWNS; ++b)
                    value += found.touch[p][a] * found.covariance[a][b] * found.touch[q][b];
            }
            total[p][q] = value;
        }
    }
}

void widen_by_profile(const Rig& rig, const Frame& frame, int rung, const Fit& fit, Uncertainty& found, Work& work) {
    double sigma[UNKNOWNS], unit[UNKNOWNS][UNKNOWNS], values[UNKNOWNS], vectors[UNKNOWNS][UNKNOWNS];
    for (double each : view(found.covariance)) {
        if (!std::isfinite(each)) return;
    }
    for (int a = 0; a < UNKNOWNS; ++a) sigma[a] = std::sqrt(found.covariance[a][a]);
    for (int a = 0; a < UNKNOWNS; ++a) {
        for (int b = 0; b < UNKNOWNS; ++b) unit[a][b] = found.covariance[a][b] / (sigma[a] * sigma[b]);
    }
    symmetric_eigen(unit, values, vectors);
    double wider = 1.0;
    Fit& there = work.other;
    for (double far : PROFILE_STEPS) {
        double axis[UNKNOWNS];
        for (int a = 0; a < UNKNOWNS; ++a) {
            axis[a] = far * sigma[a] * vectors[a][UNKNOWNS - 1] * std::sqrt(values[UNKNOWNS - 1]);
        }
        there = fit;
        there.unknowns = moved_unknowns(rig, fit.unknowns, axis);
        for (int k = 0; k < fit.size - UNKNOWNS; ++k) {
            for (int a = 0; a < UNKNOWNS; ++a) {
                there.steps[k] += found.rig_response(k, a) * (there.unknowns[a] - fit.unknowns[a]);
            }
        }
        predict(rig, frame, rung, work.bent, there, false);
        linearise(rig, frame, there, work);
        double rise = total_cost(rig, there) - fit.cost;
        rise = rise == rise ? rise : 0.0;
        wider = std::max(wider, 0.5 * far * far / std::max(rise, 0.01));
    }
    for (double& each : view(found.covariance)) each *= wider;
}

void first_order_errors(const Task& task, const Fit& fit, const Fit& reference, Errors& errors) {
    const auto& [rig, frame, rung, work] = task;
    const Changes changes = changes_by_shape(rig, frame, rung, fit, reference, work.bent);
    const Array<double, 2> moved = linear_shifts(fit, changes, work);
    for (int row = 0; row <= BY_FRICTION; ++row) {
        for (int a = 0; a < UNKNOWNS; ++a) errors[row][a] = moved(a, row);
        for (int q = 0; q < 6; ++q) {
            double error = -changes.touch[q][row];
            for (int a = 0; a < UNKNOWNS; ++a) error += fit.point_force_columns(q, a) * moved(a, row);
            errors[row][UNKNOWNS + q] = error;
        }
    }
}

void predicted_bias(const Errors& errors, const Uncertainty& found, double (&bias)[REFERENCE + 1]) {
    constexpr int DISTANCE_AND_FORCE[] = {0, UNKNOWNS + 4, UNKNOWNS + 5};
    double covariance[6][6];
    touch_covariance(found, covariance);
    const double sigma[] = {std::sqrt(found.covariance[0][0]), std::sqrt(covariance[4][4]),
                            std::sqrt(covariance[5][5])};
    const bool sound = std::isfinite(sigma[0]) && std::isfinite(sigma[1]) && std::isfinite(sigma[2]);
    for (int rung = PAPER; rung <= REFERENCE; ++rung) {
        bias[rung] = sound ? 0.0 : INFINITE;
        if (rung == REFERENCE || !sound) continue;
        for (int k = 0; k < 3; ++k) {
            const double shape = errors[rung][DISTANCE_AND_FORCE[k]] / sigma[k];
            const double friction = rung < ELASTICA ? errors[BY_FRICTION][DISTANCE_AND_FORCE[k]] / sigma[k] : 0.0;
            const double both = std::sqrt(shape * shape + friction * friction);
            if (!(both <= bias[rung])) bias[rung] = both;
        }
    }
}

double contact_evidence(const Task& task, const Task& few, const Fit& fit, const Fit& problem) {
    const auto& [rig, frame, rung, work] = task;
    Fit &free = work.free, &rough = few.work.free;
    const int rounds = rig.steps() ? ROUNDS : 0;
    const double enough = rung == REFERENCE ? fit.cost + BEYOND_DOUBT : INFINITE;
    free.scatter = fit.scatter;
    if (rung == REFERENCE && rounds && fit.points) {
        // where hardly anything would do without a contact, the steps of a few points are good enough; beyond Huber's
        // bound each then weighs as much as those that it stands for
        rough.scatter = fit.scatter * std::sqrt(static_cast<double>(rough.points) / fit.points);
        least_cost(few.rig, rough, UNKNOWNS, CLOSE_ROUNDS, few.work);
        fill(work.step.view(), 0.0);
        put_rough_steps(rig, rough, work.step.begin() + UNKNOWNS);
        step_linearly(free, work.step.begin(), work.shift);
        std::copy_n(work.step.begin() + UNKNOWNS, rig.steps(), free.steps.begin());
        constexpr double certain = 10.0;  // times that at which a better search would change nothing but the number
        const double without = total_cost(rig, free);
        if (without > fit.cost + certain * BEYOND_DOUBT) return without - fit.cost;
    }
    const double without = least_cost(rig, free, UNKNOWNS, rounds, work, enough);
    if (rung == REFERENCE && without - fit.cost > BEYOND_DOUBT) return without - fit.cost;
    // after a fit that did not converge, the linear problem about it gives a better estimate of the contact's gain
    work.other = problem;
    return without - least_cost(rig, work.other, 0, CLOSE_ROUNDS, work);
}

}  // namespace vbaa::solver
