#include "detect/free_shape.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "detect/selection.hpp"

namespace vbaa::detect {
namespace {

// SHAPE_STEPS: steps of the fit, most. CONVERGED: share of the misfit that a step leaves from which it is the last.
// LEAST_DAMPING: floor of the damping.
constexpr int SHAPE_STEPS = 14;
constexpr double CONVERGED = 0.95, LEAST_DAMPING = 1e-3;
// Largest change of an unknown in a step.
constexpr double LARGEST_STEP = 0.5;
// Position along the last segment, over its length, from which a point lies beyond the tip: blur lengthens an end.
constexpr double BEYOND = 1.5;

using Unknowns = std::array<double, SHAPE_UNKNOWNS>;

// (S + 1, 2) normalized points of the antenna, and how they move with the unknowns.
struct BentShape {
    Array<double, 2> curve;  // (S + 1, 2)
    Array<double, 3> moved;  // (S + 1, SHAPE_UNKNOWNS, 2)
};

// Turns of the antenna's directions up to the force: B (1 − q² − B² (q² − q⁶) / 30), q the share of the way that is
// left to it; the elastica under a force along its normal there, to the third order of the slope B that it has there.
void bend(const FreeShape& free, const Unknowns& unknowns, BentShape& shape) {
    const double turn = unknowns[1], lateral = unknowns[2], depth = unknowns[3], place = std::exp(unknowns[4]);
    const double both = square(lateral) + square(depth), size = std::sqrt(both);
    const int last = free.segments_m.shape[0];
    const ConstMatrix axes = free.axes;
    std::array<double, 3> point = {0.0, unknowns[0], 0.0};
    std::array<std::array<double, 3>, SHAPE_UNKNOWNS> by{};
    by[0][1] = 1.0;
    const auto in_camera = [&](const std::array<double, 3>& own, int i) {
        return own[0] * axes(0, i) + own[1] * axes(1, i) + own[2] * axes(2, i);
    };
    for (int k = 0;; ++k) {
        const double far = 1.0 / (free.clamp_m[2] + in_camera(point, 2));
        for (int i = 0; i < 2; ++i) shape.curve(k, i) = (free.clamp_m[i] + in_camera(point, i)) * far;
        for (int a = 0; a < SHAPE_UNKNOWNS; ++a)
            for (int i = 0; i < 2; ++i)
                shape.moved(k, a, i) = (in_camera(by[a], i) - shape.curve(k, i) * in_camera(by[a], 2)) * far;
        if (k == last) break;
        const double left = std::max(1.0 - (k + 0.5) / (last * place), 0.0), power = square(left);
        const double turned = 1.0 - power - both / 30.0 * (power - power * power * power);
        const double later = -2.0 * left * (1.0 - left);
        double sine = turned, versine = 0.5 * square(turned);
        if (size > 1e-4) sine = std::sin(turned * size) / size, versine = (1.0 - std::cos(turned * size)) / both;
        double x = free.segments_m(k, 0), y = free.segments_m(k, 1), z = free.segments_m(k, 2);
        // about the axis (0, −depth, lateral)
        const double over_x = -depth * z - lateral * y, over_y = lateral * x, over_z = depth * x;
        x += sine * over_x + versine * (-depth * over_z - lateral * over_y);
        y += sine * over_y + versine * lateral * over_x;
        z += sine * over_z + versine * depth * over_x;
        const double straight = x;
        x -= turn * y;
        y += turn * straight;
        point[0] += x, point[1] += y, point[2] += z;
        by[1][0] -= y, by[1][1] += x;
        by[2][0] -= turned * y, by[2][1] += turned * x;
        by[3][0] -= turned * z, by[3][2] += turned * x;
        by[4][0] += later * (-lateral * y - depth * z);
        by[4][1] += later * lateral * x, by[4][2] += later * depth * x;
    }
}

// Normal equations of the unknowns; lower half of the matrix.
struct Normal {
    double matrix[SHAPE_UNKNOWNS * SHAPE_UNKNOWNS] = {}, side[SHAPE_UNKNOWNS] = {};

    double& at(int a, int b) { return matrix[a * SHAPE_UNKNOWNS + b]; }
};

// Mean square of the distances of points (N, 2) from a curve over their variances (N,), points beyond its end count
// from the end; and its normal equations.
double distance_from(const BentShape& shape, ConstMatrix seen, ConstVector variance, Normal& normal) {
    const int last = shape.curve.shape[0] - 2;
    double total = 0.0;
    normal = {};
    for (int i = 0, k = 0; i < seen.shape[0]; ++i) {
        double u, v, x, y, length, part;
        for (;; ++k) {
            u = shape.curve(k + 1, 0) - shape.curve(k, 0), v = shape.curve(k + 1, 1) - shape.curve(k, 1);
            x = seen(i, 0) - shape.curve(k, 0), y = seen(i, 1) - shape.curve(k, 1);
            length = u * u + v * v;
            part = (x * u + y * v) / length;
            if (part <= 1.0 || k == last) break;
        }
        length = std::sqrt(length);
        const double weight = 1.0 / (variance[i] * seen.shape[0]);
        const auto add = [&](double off, auto by) {
            total += weight * off * off;
            double row[SHAPE_UNKNOWNS];
            for (int a = 0; a < SHAPE_UNKNOWNS; ++a) {
                const double before_u = shape.moved(k, a, 0), before_v = shape.moved(k, a, 1);
                row[a] = by(before_u + part * (shape.moved(k + 1, a, 0) - before_u),
                            before_v + part * (shape.moved(k + 1, a, 1) - before_v));
                normal.side[a] += weight * row[a] * off;
                for (int b = 0; b <= a; ++b) normal.at(a, b) += weight * row[a] * row[b];
            }
        };
        add((y * u - x * v) / length, [&](double by_u, double by_v) { return (by_v * u - by_u * v) / length; });
        if (part > BEYOND)
            add((part - BEYOND) * length, [&](double by_u, double by_v) { return (by_u * u + by_v * v) / length; });
    }
    return total;
}

}  // namespace

double misfit(const FreeShape& free, ConstMatrix seen, ConstVector variance, ConstVector allowed, double enough,
              ConstMatrix starts) {
    const Unknowns prior = {1.0 / square(allowed[0]), 1.0 / square(allowed[1]), 0.0, 1.0 / square(allowed[2]), 0.0};
    const int count = free.segments_m.shape[0] + 1;
    BentShape shape = {Array<double, 2>(count, 2), Array<double, 3>(count, SHAPE_UNKNOWNS, 2)};
    double least = INFINITE;
    for (int s = 0; s < starts.shape[0]; ++s) {
        Unknowns trial;
        std::copy(starts.row(s).begin(), starts.row(s).end(), trial.begin());
        Unknowns unknowns = trial;
        Normal here, best_here;
        double best = INFINITE, damping = 1e-3;
        for (int step = 0; step <= SHAPE_STEPS; ++step) {
            bend(free, trial, shape);
            const double off = distance_from(shape, seen, variance, here);
            least = std::min(least, off + prior[0] * square(trial[0]) + prior[1] * square(trial[1]));
            if (least <= enough) return least;
            double total = off;
            for (int a = 0; a < SHAPE_UNKNOWNS; ++a) total += prior[a] * square(trial[a]);
            if (CONVERGED * best < total && total < best) break;
            if (total < best) {
                unknowns = trial, best_here = here, best = total, damping *= 0.2;
                for (int a = 0; a < SHAPE_UNKNOWNS; ++a) best_here.side[a] -= prior[a] * unknowns[a];
            } else {
                damping *= 10.0;
            }
            here = best_here;
            for (int a = 0; a < SHAPE_UNKNOWNS; ++a)
                here.at(a, a) = (1.0 + damping) * (best_here.at(a, a) + prior[a]) + LEAST_DAMPING;
            solve_definite({here.matrix, {SHAPE_UNKNOWNS, SHAPE_UNKNOWNS}}, {here.side, {SHAPE_UNKNOWNS, 1}});
            for (int a = 0; a < SHAPE_UNKNOWNS; ++a)
                trial[a] = unknowns[a] + std::min(std::max(here.side[a], -LARGEST_STEP), LARGEST_STEP);
        }
    }
    return least;
}

Runs means_of_runs(ConstMatrix points, ConstVector sigma, int most) {
    const int all = points.shape[0], count = std::min(most, all);
    Runs runs{Array<double, 2>(count, 2), Array<double, 1>(count)};
    for (int i = 0; i < count; ++i) {
        const int first = static_cast<int>(static_cast<std::int64_t>(i) * all / count);
        const int last = static_cast<int>((i + std::int64_t{1}) * all / count);
        const double run = last - first;
        for (int n = first; n < last; ++n) {
            for (int axis = 0; axis < 2; ++axis) runs.means(i, axis) += points(n, axis) / run;
            runs.variance[i] += square(sigma[n] / run);
        }
    }
    return runs;
}

}  // namespace vbaa::detect
