#include "solver/marginal.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "linear_algebra.hpp"
#include "solver/convergence.hpp"
#include "solver/initialization.hpp"
#include "solver/normal_equations.hpp"
#include "solver/rig_jacobian.hpp"
#include "solver/uncertainty.hpp"

namespace vbaa::solver {
namespace {

constexpr MarginalSettings settings;

// Laplace's approximation at one value of the force along the line of sight.
struct Slice {
    double along, log_density;
    Unknowns unknowns;
    double covariance[UNKNOWNS][UNKNOWNS], touch[6], touch_covariance[6][6];
};

// Adds a term that fixes the force along the line of sight at a value; returns its weight.
double fix(const Rig& rig, const Frame& frame, double along, Fit& fit) {
    const double weight = settings.fixed_weight * (fit.information(1, 1) + fit.information(2, 2));
    const double pull = weight * (along - along_sight(rig, frame, fit.unknowns));
    const auto& to_camera = rig.cameras[frame.seen_by].to_camera;
    for (int a = 0; a < 2; ++a) {
        fit.side[1 + a] += pull * to_camera[a];
        for (int b = 0; b < 2; ++b) fit.information(1 + a, 1 + b) += weight * to_camera[a] * to_camera[b];
    }
    return weight;
}

// Gauss–Newton's step at a fixed force, into `work.step`.
void fixed_step(const Fit& fit, Work& work) {
    const double distance = fit.unknowns[0];
    double* step = work.step.begin();
    factorise(fit.information, 0, fit.size, 0.0, work.factor, work.scale);
    solve_factorised(work.factor, work.scale, fit.size, fit.side.begin(), step);
    if (!((distance <= NEAREST && step[0] < 0.0) || (distance >= TIP && step[0] > 0.0))) return;
    step[0] = 0.0;
    factorise(fit.information, 1, fit.size - 1, 0.0, work.factor, work.scale);
    solve_factorised(work.factor, work.scale, fit.size - 1, &fit.side[1], step + 1);
}

// The best fit with a fixed force along the line of sight, from one near it; false without one.
bool reach(const Task& task, double along, double tolerance, Fit& fit) {
    const auto& [rig, frame, rung, work] = task;
    for (int round = 0; round < settings.most_rounds; ++round) {
        const double before = fit.cost;
        fix(rig, frame, along, fit);
        fixed_step(fit, work);
        fit.unknowns = moved_unknowns(rig, fit.unknowns, work.step.begin());
        for (int k = 0; k < fit.steps.size(); ++k) fit.steps[k] += work.step[UNKNOWNS + k];
        evaluate(rig, frame, rung, fit, work);
        if (!std::isfinite(fit.cost) || !(std::abs(fit.unknowns[3]) < LARGEST_FRICTION)) return false;
        const bool there = std::abs(along - along_sight(rig, frame, fit.unknowns)) < tolerance;
        if (there && std::abs(fit.cost - before) < settings.cost_change) break;
    }
    return true;
}

// Laplace's approximation about a fit: density of the force along the line of sight, moments of all else.
Slice slice_of(const Rig& rig, const Frame& frame, Fit& fit, Work& work) {
    Slice slice;
    const int size = fit.size;
    slice.along = along_sight(rig, frame, fit.unknowns);
    const double weight = fix(rig, frame, slice.along, fit);
    fixed_step(fit, work);
    double promise = 0.0;
    for (int k = 0; k < size; ++k) promise += fit.side[k] * work.step[k];
    const Array<double, 1> step = work.step;
    slice.unknowns = moved_unknowns(rig, fit.unknowns, step.begin());
    factorise(fit.information, 0, size, 0.0, work.factor, work.scale);
    double log_density = 0.5 * std::log(weight) - fit.cost + 0.5 * promise;
    for (int k = 0; k < size; ++k) log_density += std::log(work.factor(k, k)) + std::log(work.scale[k]);
    Array<double, 2> sides(size, 2 * LANES);
    for (int k = 0; k < size; ++k) {
        if (k < UNKNOWNS) sides(k, k) = 1.0;
        for (int q = 0; q < 6; ++q) sides(k, UNKNOWNS + q) = fit.point_force_columns(q, k);
    }
    solve_many(work.factor, work.scale, size, sides, true);
    for (int a = 0; a < UNKNOWNS; ++a) {
        for (int b = 0; b < UNKNOWNS; ++b) slice.covariance[a][b] = sides(a, b);
    }
    for (int p = 0; p < 6; ++p) {
        slice.touch[p] = fit.point_force[p];
        for (int k = 0; k < size; ++k) {
            const double by = k < UNKNOWNS ? slice.unknowns[k] - fit.unknowns[k] : fit.steps[k - UNKNOWNS] + step[k];
            slice.touch[p] += fit.point_force_columns(p, k) * by;
        }
        for (int q = 0; q < 6; ++q) {
            slice.touch_covariance[p][q] = 0.0;
            for (int k = 0; k < size; ++k) {
                slice.touch_covariance[p][q] += fit.point_force_columns(p, k) * sides(k, UNKNOWNS + q);
            }
        }
    }
    const auto& spread = slice.covariance;
    const double y = slice.unknowns[1], z = slice.unknowns[2];
    slice.log_density = log_density - std::log(y * y + z * z + spread[1][1] + spread[2][2]);
    return slice;
}

// Places on one side of a fit, away from it.
void sweep(const Task& task, const Fit& start, const Slice& middle, double step, std::vector<Slice>& slices) {
    const auto& [rig, frame, rung, work] = task;
    Fit &fit = work.other, &kept = work.found;
    fit = start;
    double most = middle.log_density, last = most, along = middle.along, deflected = along;
    int halvings = 0;
    for (int count = 0; count < settings.most_slices && work.evaluations < work.most; ++count) {
        const double distance = fit.unknowns[0], bound = settings.largest_load / load_at(rig, distance);
        const double target = std::min(std::max(along + step, -bound), bound);
        if (!((target - along) * step > 0.0)) return;
        kept = fit;
        if (!reach(task, target, settings.off_place * std::abs(step), fit)) return;
        const Slice slice = slice_of(rig, frame, fit, work);
        if (!std::isfinite(slice.log_density)) return;
        const double change = std::abs(slice.log_density - last);
        if (change > settings.coarse && halvings < settings.most_halvings) {
            fit = kept;
            step *= 0.5;
            ++halvings;
            continue;
        }
        slices.push_back(slice);
        along = target;
        last = slice.log_density;
        most = std::max(most, last);
        if (last < most - settings.nothing) return;
        if (change < settings.fine) step *= settings.longer;
        if (std::abs(along - deflected) * tip_deflection(rig, distance) > settings.far && fit.steps.size()) {
            rig_jacobian(rig, frame, rung, work.bent, fit);
            deflected = along;
        }
        evaluate(rig, frame, rung, fit, work);
    }
}

// Places about a fit, on both sides.
void sweep_about(const Task& task, const Fit& start, double step, std::vector<Slice>& slices) {
    const auto& [rig, frame, rung, work] = task;
    work.other = start;
    evaluate(rig, frame, rung, work.other, work);
    const Slice middle = slice_of(rig, frame, work.other, work);
    if (!std::isfinite(middle.log_density)) return;
    slices.push_back(middle);
    for (double side : {1.0, -1.0}) sweep(task, start, middle, side * step, slices);
}

// Adds a part's values and covariance to the first and second moments of a whole.
void add_moments(double weight, ConstVector values, ConstMatrix covariance, Vector mean, Matrix square) {
    for (int a = 0; a < mean.size(); ++a) {
        mean[a] += weight * values[a];
        for (int b = 0; b < mean.size(); ++b) square(a, b) += weight * (covariance(a, b) + values[a] * values[b]);
    }
}

// Covariance from second moments, inflated.
void centre(ConstVector mean, double inflation, Matrix square) {
    for (int a = 0; a < mean.size(); ++a) {
        for (int b = 0; b < mean.size(); ++b) square(a, b) = inflation * (square(a, b) - mean[a] * mean[b]);
    }
}

// Slices, from the first to the one before the end, outside of which hardly any weight is.
std::pair<int, int> inner_slices(const std::vector<double>& weights, double total) {
    const double least = settings.tail * total;
    int first = 0, end = static_cast<int>(weights.size());
    double before = weights[first], behind = weights[end - 1];
    while (before < least) before += weights[++first];
    while (behind < least) behind += weights[--end - 1];
    return {first, end};
}

// Widens a covariance towards a slice's values until none of these is farther than `tail_std` from the mean.
void widen(ConstVector mean, ConstVector values, Matrix covariance) {
    const int size = mean.size();
    double part = 0.0;
    for (int a = 0; a < size; ++a) {
        const double square = (values[a] - mean[a]) * (values[a] - mean[a]);
        if (square > 0.0)
            part = std::max(part, 1.0 / (settings.tail_std * settings.tail_std) - covariance(a, a) / square);
    }
    for (int a = 0; a < size; ++a) {
        for (int b = 0; b < size; ++b) covariance(a, b) += part * (values[a] - mean[a]) * (values[b] - mean[b]);
    }
}

}  // namespace

void marginalise(const Task& task, Fit& best, const Alternative& other, Uncertainty& found, Marginal& marginal) {
    const auto& [rig, frame, rung, work] = task;
    const auto& [e_y, e_z] = rig.cameras[frame.seen_by].to_camera;
    const double sway = tip_deflection(rig, best.unknowns[0]);
    const double variance = e_y * e_y * found.covariance[1][1] + 2.0 * e_y * e_z * found.covariance[1][2] +
                            e_z * e_z * found.covariance[2][2];
    double step = settings.first_step_deflection / sway;
    if (std::isfinite(variance)) step = std::min(step, settings.first_step_std * std::sqrt(std::max(variance, 0.0)));
    std::vector<Slice> slices;
    work.most = MOST_EVALUATIONS + work.evaluations;
    Fit start = best;
    start.at_tip = false;
    sweep_about(task, start, step, slices);
    if (slices.size() < 3) return;
    const auto [low, high] = std::minmax_element(slices.begin(), slices.end(),
                                                 [](const Slice& a, const Slice& b) { return a.along < b.along; });
    const double there = along_sight(rig, frame, other.unknowns);
    if (std::isfinite(other.cost) && !(low->along < there && there < high->along)) {
        start.unknowns = other.unknowns;
        evaluate(rig, frame, rung, start, work);
        if (start.steps.size()) rig_jacobian(rig, frame, rung, work.bent, start);
        evaluate(rig, frame, rung, start, work);
        if (reach(task, there, settings.off_place * step, start)) {
            sweep_about(task, start, step, slices);
        }
    }
    std::sort(slices.begin(), slices.end(), [](const Slice& a, const Slice& b) { return a.along < b.along; });
    double most = slices.front().log_density, total = 0.0;
    for (const Slice& slice : slices) most = std::max(most, slice.log_density);
    const int last = static_cast<int>(slices.size()) - 1;
    std::vector<double> weights(slices.size());
    for (int k = 0; k <= last; ++k) {
        const double width = slices[std::min(k + 1, last)].along - slices[std::max(k - 1, 0)].along;
        weights[k] = width * std::exp(slices[k].log_density - most);
        total += weights[k];
    }
    if (!(total > 0.0)) return;
    marginal = {};
    double covariance[UNKNOWNS][UNKNOWNS] = {};
    const Vector mean = {marginal.mean.data(), {UNKNOWNS}};
    for (int k = 0; k <= last; ++k) {
        const double weight = weights[k] / total;
        Slice& slice = slices[k];
        add_moments(weight, {slice.unknowns.data(), {UNKNOWNS}}, view(slice.covariance), mean, view(covariance));
        add_moments(weight, view(slice.touch), view(slice.touch_covariance), view(marginal.touch),
                    view(marginal.touch_covariance));
    }
    const double inflation = huber_variance_inflation(best);
    centre(mean, inflation, view(covariance));
    centre(view(marginal.touch), inflation, view(marginal.touch_covariance));
    // where the tails are heavier than a normal distribution's
    const auto [first, end] = inner_slices(weights, total);
    for (int k = first; k < end; ++k) {
        widen(mean, {slices[k].unknowns.data(), {UNKNOWNS}}, view(covariance));
        widen(view(marginal.touch), view(slices[k].touch), view(marginal.touch_covariance));
    }
    // at the tip as far as that is no less likely than other places
    const double back = TIP - mean[0];
    best.at_tip = !(back > 0.0) || (best.at_tip && back * back < covariance[0][0]);
    if (best.at_tip) covariance[0][0] += back * back, mean[0] = TIP;
    marginal.known = true;
    work.other = best;
    fix(rig, frame, along_sight(rig, frame, best.unknowns), work.other);
    uncertainty(work.other, found, work);
    std::copy_n(found.covariance[0], UNKNOWNS * UNKNOWNS, marginal.fixed[0]);
    std::copy_n(covariance[0], UNKNOWNS * UNKNOWNS, found.covariance[0]);
}

}  // namespace vbaa::solver
