#include "solver/convergence.hpp"

#include <algorithm>
#include <cmath>

#include "linear_algebra.hpp"
#include "order.hpp"
#include "solver/normal_equations.hpp"
#include "solver/prediction.hpp"
#include "solver/rig_jacobian.hpp"

namespace vbaa::solver {
namespace {

constexpr int ITERATIONS = 40;
// A step with a smaller predicted decrease of the cost is the last one, and taken undamped: a twentieth of a standard
// deviation, or three.
constexpr double TOLERANCE = 1e-3, COARSE_TOLERANCE = 4.0;
// Change of the distance or the tip's deflection, in antenna lengths, after which the rig's derivatives are renewed.
constexpr double FAR = 0.005;
// A smaller rise of the cost counts as none: it is not known better while the feet are not yet the nearest.
constexpr double COST_NOISE = 1e-3;
// Least damping, on a unit diagonal, after a step that was poorly predicted.
constexpr double DAMPING = 1e-3;
// A step to more than this many times the lowest cost is not followed.
constexpr double MOST_COST = 100.0;
// Longest step of the tip's deflection, in antenna lengths: along the line of sight hardly anything limits it.
constexpr double LONGEST = 0.2;
// Part of a step over which the lever's derivative is taken.
constexpr double AHEAD = 1e-3;
// A distance this near to the tip is fixed there if that costs no more than this: two standard deviations.
constexpr double NEAR_TIP = 0.03, TIP_COST = 2.0;
// The scatter is estimated again until it changes by less than this part.
constexpr int ROUNDS = 3;
constexpr double SCATTER_CHANGE = 0.1;
// Evaluations for each search while most points lie far off every fit so far.
constexpr int MOST_HOPELESS = 60;

// Recomputes residuals and normal equations at the same prediction.
void renew(const Rig& rig, const Frame& frame, Fit& fit, Work& work) {
    linearise(rig, frame, fit, work);
    normal_equations(rig, fit, 0, work.product);
}

// The fit at its unknowns, with a rough fit's rig steps and derivatives by them, or else the rig as calibrated and its
// derivatives for small deflections.
void begin(const Task& task, const Fit* rough, Fit& fit, bool with_feet, double scatter) {
    const auto& [rig, frame, rung, work] = task;
    fit.scatter = scatter;
    fit.converged = fit.at_tip = false;
    fit.to_tip = {};
    fill(fit.steps.view(), 0.0);
    if (rough != nullptr) put_rough_steps(rig, *rough, fit.steps.begin());
    predict(rig, frame, rung, work.bent, fit, true);
    rig_jacobian(rig, frame, rough == nullptr ? LINEAR : rung, work.bent, fit);
    work.slopes_at = fit.unknowns;
    if (!with_feet) nearest_feet(rig, frame, fit);
    renew(rig, frame, fit, work);
}

// The clamp's moment per force, in antenna lengths; friction adds the load F·l²/EI over 6 to it.
double lever_of(const Rig& rig, double distance, double force_y, double force_z, double friction) {
    const double load = std::sqrt(force_y * force_y + force_z * force_z) * load_at(rig, distance);
    return distance * std::min(std::max(1.0 - std::tan(rig.friction_rad * friction) * load / 6.0, 0.2), 5.0);
}

// Levenberg–Marquardt's step (K,) from a fit, into `work.step`; returns the predicted decrease of the cost.
double damped_step(const Rig& rig, const Fit& fit, double damping, Work& work) {
    const int size = fit.size;
    const double distance = fit.unknowns[0];
    Array<double, 1>& step = work.step;
    bool fixed = fit.at_tip;
    if (!fixed) {
        factorise(fit.information, 0, size, damping, work.factor, work.scale);
        solve_factorised(work.factor, work.scale, size, fit.side.begin(), step.begin());
        fixed = (distance <= NEAREST && step[0] < 0.0) || (distance >= TIP && step[0] > 0.0);
    }
    if (fixed) {
        step[0] = 0.0;
        factorise(fit.information, 1, size - 1, damping, work.factor, work.scale);
        solve_factorised(work.factor, work.scale, size - 1, fit.side.begin() + 1, step.begin() + 1);
    }
    const double bent = std::hypot(step[1], step[2]) * tip_deflection(rig, distance);
    const double shorter = std::min(LONGEST / std::max(bent, 1e-12), 1.0);
    for (int a = 0; a < size; ++a) step[a] *= shorter;
    double promise = 0.0;
    for (int a = 0; a < size; ++a) {
        double curvature = 0.0;
        for (int b = 0; b < size; ++b) curvature += fit.information(a, b) * step[b];
        promise += (fit.side[a] - 0.5 * curvature) * step[a];
    }
    return promise;
}

void evaluate_at(const Rig& rig, const Frame& frame, int rung, bool with_rig, Fit& fit, Work& work) {
    ++work.evaluations;
    predict(rig, frame, rung, work.bent, fit, true);
    if (with_rig) {
        rig_jacobian(rig, frame, rung, work.bent, fit);
        work.slopes_at = fit.unknowns;
    }
    renew(rig, frame, fit, work);
}

// Whether a descent went so far that the rig's derivatives have changed.
bool moved_far(const Rig& rig, const Unknowns& start, const Unknowns& end) {
    const double first = tip_deflection(rig, start[0]), last = tip_deflection(rig, end[0]);
    const double bent = std::hypot(end[1] * last - start[1] * first, end[2] * last - start[2] * first);
    return std::abs(end[0] - start[0]) > FAR || bent > FAR;
}

void move(const Rig& rig, const double* step, Fit& fit) {
    fit.unknowns = moved_unknowns(rig, fit.unknowns, step);
    for (int k = 0; k < fit.steps.size(); ++k) fit.steps[k] += step[UNKNOWNS + k];
}

// How a minimum is searched: which step is the last, and whether the rig's derivatives are good as they are. Otherwise
// they are renewed until the minimum is near: a descent is one of the same function only where they stay.
struct Descent {
    double tolerance;
    bool with_slopes;
    int iterations = ITERATIONS;
};

// The minimum below a fit, converged or not.
//
// A step that raises the cost is accepted once, since along a bent valley the next one may lower it; if that one does
// not either, the descent goes on from its lowest state, damped.
void descend(const Rig& rig, const Frame& frame, int rung, Descent how, Fit& fit, Work& work) {
    // predicted decrease below which the rig's derivatives are good as they are
    constexpr double small = 1.0;
    const double tolerance = how.tolerance;
    double damping = 0.0, least = fit.cost;
    bool uphill = false, stale = false, undamped = false, own = how.with_slopes;
    bool near = own && tolerance > small;
    fit.converged = false;
    for (int iteration = 0; iteration < how.iterations; ++iteration) {
        double promise = damped_step(rig, fit, damping, work);
        if (promise < tolerance && damping > 0.0 && !undamped) {
            promise = damped_step(rig, fit, damping = 0.0, work);
            undamped = true;
        }
        near = near || (own && (promise < small || stale));
        fit.converged = promise < tolerance && !uphill && own;
        if (work.evaluations >= work.most) break;
        if (fit.converged && stale) {
            evaluate_at(rig, frame, rung, false, fit, work);
            promise = damped_step(rig, fit, damping, work);
            stale = false;
        }
        if (fit.converged) {
            step_linearly(fit, work.step.begin(), work.shift);
            move(rig, work.step.begin(), fit);
            fit.cost -= promise;
            break;
        }
        const double before = fit.cost;
        if (!uphill) keep(fit, work.kept);
        move(rig, work.step.begin(), fit);
        evaluate_at(rig, frame, rung, !near, fit, work);
        own = true;
        const bool better = fit.cost <= least + COST_NOISE;
        const double gain = (before - fit.cost) / std::max(promise, 1e-300);
        if (better) {
            if (gain > 0.75) damping *= 0.1;
            if (gain < 0.25) damping = std::max(4.0 * damping, DAMPING);
            least = fit.cost;
            uphill = stale = false;
            continue;
        }
        const bool back = uphill || !(fit.cost < MOST_COST * least);
        if (back) {
            go_back(work.kept, fit);
            damping = std::max(10.0 * damping, DAMPING);
        }
        uphill = !back;
        stale = true;
        if (back && iteration < 2) {
            // evaluated again at the start, where the feet were not yet the nearest
            evaluate_at(rig, frame, rung, false, fit, work);
            least = fit.cost;
            stale = false;
        }
    }
    if (uphill) go_back(work.kept, fit);
    if (stale) evaluate_at(rig, frame, rung, false, fit, work);
}

// Median residual of the points over its expectation, 1 unless it is too large for noise. Points beyond the antenna's
// end are as far off as that end.
double scatter_of(const Rig& rig, const Frame& frame, const Fit& fit) {
    const int count = fit.points;
    if (count == 0) return 1.0;
    const auto square = [&](int i) {
        double along = 0.0;
        if (!(fit.foot_m[i] < rig.length_m)) {
            const int tip = frame.clamp[i] + LAST;
            along = (frame.u()[i] - fit.u[tip]) * fit.normal_v[tip] - (frame.v()[i] - fit.v[tip]) * fit.normal_u[tip];
        }
        return (fit.distance[i] * fit.distance[i] + along * along) * fit.precision[i];
    };
    const double largest = 1.0 + EXCESS_SCATTER / std::sqrt(count);
    const double bound = (largest / MAD_SCALE) * (largest / MAD_SCALE);
    int above = 0;
    for (int i = 0; i < count; ++i) above += !(square(i) <= bound);
    if (above < count - count / 2) return 1.0;
    std::vector<double> size(count);
    for (int i = 0; i < count; ++i) size[i] = std::sqrt(square(i));
    const double median = MAD_SCALE * nth_smallest(size, count / 2);
    return median > largest ? std::min(median, MOST_SCATTER) : 1.0;
}

// Fixes the fit's distance at the tip where the data cannot distinguish it from there.
void try_tip(const Rig& rig, const Frame& frame, int rung, Fit& fit, Work& work) {
    Fit& free = work.other;
    free = fit;
    fit.unknowns[0] = TIP;
    fit.at_tip = true;
    evaluate_at(rig, frame, rung, true, fit, work);
    descend(rig, frame, rung, {TOLERANCE, true}, fit, work);
    for (int a = 0; a < UNKNOWNS; ++a) fit.to_tip[a] = fit.unknowns[a] - free.unknowns[a];
    if (!(fit.cost <= free.cost + TIP_COST)) fit = free;
}

}  // namespace

void converge(const Task& task, const Fit* rough, Fit& fit, bool with_feet) {
    const auto& [rig, frame, rung, work] = task;
    begin(task, rough, fit, with_feet, 1.0);
    descend(rig, frame, rung, {TOLERANCE, rough != nullptr}, fit, work);
    for (int turn = 0; turn < ROUNDS && moved_far(rig, work.slopes_at, fit.unknowns); ++turn) {
        evaluate_at(rig, frame, rung, true, fit, work);
        descend(rig, frame, rung, {TOLERANCE, true}, fit, work);
    }
    for (int round = 0; round < ROUNDS; ++round) {
        const double scatter = scatter_of(rig, frame, fit);
        if (!(std::abs(scatter - fit.scatter) > SCATTER_CHANGE * fit.scatter)) break;
        fit.scatter = scatter;
        evaluate_at(rig, frame, rung, true, fit, work);
        descend(rig, frame, rung, {TOLERANCE, true}, fit, work);
    }
    if (fit.scatter < MOST_SCATTER) work.most = MOST_EVALUATIONS;
    if (fit.unknowns[0] > TIP - NEAR_TIP) try_tip(rig, frame, rung, fit, work);
}

bool converge_there(const Rig& rig, const Frame& frame, int rung, Fit& fit, Work& work) {
    begin({rig, frame, rung, work}, nullptr, fit, true, 1.0);
    fit.at_tip = true;
    descend(rig, frame, rung, {TOLERANCE, false}, fit, work);
    double scatter = scatter_of(rig, frame, fit);
    // where one of several cameras' points scatter, the others hold the antenna
    for (int round = 0; rig.cameras.size() > 1 && round < ROUNDS && scatter < WRONG_SHAPE; ++round) {
        if (!(std::abs(scatter - fit.scatter) > SCATTER_CHANGE * fit.scatter)) break;
        fit.scatter = scatter;
        evaluate_at(rig, frame, rung, true, fit, work);
        descend(rig, frame, rung, {TOLERANCE, true}, fit, work);
        scatter = scatter_of(rig, frame, fit);
    }
    fit.at_tip = false;
    return fit.converged && (scatter == 1.0 || (fit.scatter > 1.0 && scatter < WRONG_SHAPE));
}

void begin_search(Work& work) {
    const int granted = std::min(work.evaluations + MOST_HOPELESS, MOST_EVALUATIONS);
    work.most = std::max(work.most, granted);
}

void coarse_minimum(const Task& task, Fit& fit, bool with_feet, double scatter, int iterations) {
    begin(task, nullptr, fit, with_feet, scatter);
    descend(task.rig, task.frame, task.rung, {COARSE_TOLERANCE, true, iterations}, fit, task.work);
}

Unknowns moved_unknowns(const Rig& rig, const Unknowns& unknowns, const double* step) {
    const double old = unknowns[0], force_y = unknowns[1], force_z = unknowns[2];
    const double distance = std::min(std::max(old + step[0], std::max(0.5 * old, NEAREST)), TIP);
    const double friction = std::min(std::max(unknowns[3] + step[3], -LARGEST_FRICTION), LARGEST_FRICTION);
    const double lever = lever_of(rig, old, force_y, force_z, unknowns[3]);
    const double ahead = lever_of(rig, old + AHEAD * step[0], force_y + AHEAD * step[1], force_z + AHEAD * step[2],
                                  unknowns[3] + AHEAD * step[3]);
    const double change = (ahead - lever) / AHEAD;
    const double moment_y = lever * (force_y + step[1]) + change * force_y;
    const double moment_z = lever * (force_z + step[2]) + change * force_z;
    double found_y = force_y, found_z = force_z;
    for (int round = 0; round < 2; ++round) {
        const double there = lever_of(rig, distance, found_y, found_z, friction);
        found_y = moment_y / there;
        found_z = moment_z / there;
    }
    return {distance, found_y, found_z, friction};
}

}  // namespace vbaa::solver
