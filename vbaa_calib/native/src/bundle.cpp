// Levenberg–Marquardt on the reprojection error; the poses are eliminated view by view (Schur complement).
#include "bundle.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "lanes.hpp"

namespace vbaa::bundle {
namespace {

constexpr double LEAST_DAMPING = 1e-15, MOST_DAMPING = 1e12, SINGULAR = 1e-15;
constexpr int REWEIGHTINGS = 12, FEW = 2;  // rounds of reweighting, and steps in each but the first
constexpr double CONVERGED_WEIGHTS = 1e-2, ROUGH = 1e-4, FURTHEST_PER_CORNER = 4.0, LEAST_VARIANCE = 0.05;
// Scale of Cauchy's loss for 95 % efficiency on normal noise, over the median length; and its least, px.
constexpr double CAUCHY_PER_MEDIAN = 2.385 / 1.1774, LEAST_PX = 2.385e-9;

using Column = View<const std::int64_t, 1>;

// The normal equations at a state; the last row and column of `total` and `coupling` are the residuals'.
struct System {
    State state;
    Array<double, 2> residuals, total;
    Array<double, 3> coupling, own;  // (V, 6, p + 1) and (V, 6, 6) of the poses
    double cost = 0.0;
};

struct Step {
    bool possible = true;
    std::vector<double> shared;  // (p,) of the unknowns
    Array<double, 2> poses;      // (V, 6)
    double promise = 0.0;        // decrease of the cost
};

struct Problem {
    const Corners& corners;
    Column column;
    const Priors& priors;
    std::vector<double> weights;  // (N,) of squared residuals
    int free = 0;                 // unknowns besides the poses
    Array<double, 2> rows, picked, block, lacking_by_lens;
    Array<double, 3> through;
    Array<double, 1> lacking;

    Problem(const Corners& corners_, Column column_, const Priors& priors_, int size)
        : corners(corners_), column(column_), priors(priors_), weights(corners.weights.begin(), corners.weights.end()) {
        for (double& weight : weights) weight *= weight;
        for (std::int64_t one : column) free = std::max(free, static_cast<int>(one) + 1);
        const int wide = 2 * whole_lanes(corners.most());
        rows = Array<double, 2>(size + SHAPE + POSE + 1, wide);
        picked = Array<double, 2>(free + 1 + POSE, wide), block = Array<double, 2>(free + 1 + POSE, free + 1 + POSE);
        lacking = Array<double, 1>(RADII), lacking_by_lens = Array<double, 2>(RADII, size);
        through = Array<double, 3>(corners.views(), POSE, free + 1);
    }

    System linearised(State state);
    void pick(int view);
    double add_priors(Matrix total, const State& state);
    Step step(const System& system, double damping);
    State moved(const State& state, const Step& step) const;
    System descended(State state, const Rules& rules);
    double reweight(ConstMatrix residuals);
};

// Lower triangle of the products of rows (m, M); two by two rows at a time, to read less memory.
void products(Matrix block, ConstMatrix rows) {
    const int count = rows.shape[0], wide = rows.shape[1];
    for (int i = 0; i < count; i += 2)
        for (int j = 0; j <= i; j += 2) {
            const int k = std::min(i + 1, count - 1), l = std::min(j + 1, count - 1);
            Lanes ij = {}, il = {}, kj = {}, kl = {};
            for (int n = 0; n < wide; n += LANES) {
                const Lanes a = load(&rows(i, n)), b = load(&rows(k, n));
                const Lanes c = load(&rows(j, n)), d = load(&rows(l, n));
                ij += a * c, il += a * d, kj += b * c, kl += b * d;
            }
            block(i, l) = sum(il), block(k, l) = sum(kl), block(k, j) = sum(kj), block(i, j) = sum(ij);
        }
}

// Solve in place for right sides (n, m), with the factor from `factored`.
void solve_factored(ConstMatrix factor, Matrix right) {
    const int n = right.shape[0], m = right.shape[1];
    for (int i = 0; i < n; ++i) {
        for (int k = 0; k < i; ++k)
            for (int j = 0; j < m; ++j) right(i, j) -= factor(i, k) * right(k, j);
        for (int j = 0; j < m; ++j) right(i, j) *= factor(i, i);
    }
    for (int i = n - 1; i >= 0; --i) {
        for (int k = i + 1; k < n; ++k)
            for (int j = 0; j < m; ++j) right(i, j) -= factor(k, i) * right(k, j);
        for (int j = 0; j < m; ++j) right(i, j) *= factor(i, i);
    }
}

struct Quaternion {
    double w, x, y, z;

    static Quaternion of(const double* turn) {
        const double angle = std::sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);
        const double share = angle > 1e-8 ? std::sin(0.5 * angle) / angle : 0.5;
        return {std::cos(0.5 * angle), share * turn[0], share * turn[1], share * turn[2]};
    }
};

// Turn a rotation vector, in place, by another.
void turn_by(const double* by, double* turn) {
    const Quaternion a = Quaternion::of(by), b = Quaternion::of(turn);
    const double w = a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z;
    const double x = a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y;
    const double y = a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x;
    const double z = a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w;
    const double sine = std::sqrt(x * x + y * y + z * z), angle = 2.0 * std::atan2(sine, std::abs(w));
    const double share = std::copysign(sine > 1e-8 ? angle / sine : 2.0, w);  // the shorter way round
    turn[0] = share * x, turn[1] = share * y, turn[2] = share * z;
}

// Selects a view's weighted rows of the unknowns (p,), the residuals and the pose (6,).
void Problem::pick(int view) {
    const int size = column.shape[0], half = picked.shape[1] / 2, count = corners.count(view);
    std::vector<double> roots(half);
    for (int n = 0; n < count; ++n) roots[n] = std::sqrt(weights[corners.first(view) + n]);
    fill(picked.view(), 0.0);
    for (int i = 0; i < rows.shape[0]; ++i) {
        const int place = i < size + POSE ? free + 1 + i - size : free;
        const int to = i < size ? static_cast<int>(column[i]) : place;
        if (to < 0) continue;
        for (int n = 0; n < half; ++n) picked(to, n) += roots[n] * rows(i, n);
        for (int n = 0; n < half; ++n) picked(to, half + n) += roots[n] * rows(i, half + n);
    }
}

// Cost of the priors of lens and shape, after adding them to the equations.
double Problem::add_priors(Matrix total, const State& state) {
    const int size = state.lens.size();
    double cost = 0.0;
    if (priors.least_slope > 0.0) {
        const int count = unfolding_rows(state.lens, state.fisheye, priors, lacking, lacking_by_lens);
        for (int row = 0; row < count; ++row) {
            cost += lacking[row] * lacking[row];
            for (int i = 4; i < size; ++i) {
                if (column[i] < 0) continue;
                const int at = static_cast<int>(column[i]);
                for (int j = 4; j < size; ++j)
                    if (column[j] >= 0 && column[j] <= column[i])
                        total(at, static_cast<int>(column[j])) += lacking_by_lens(row, i) * lacking_by_lens(row, j);
                total(free, at) += lacking[row] * lacking_by_lens(row, i);
            }
        }
    }
    if (!(priors.noise_px > 0.0)) return cost;
    for (int i = 0; i < SHAPE; ++i) {
        const double off = (state.shape[i] - priors.mean[i]) / priors.std[i], tail = priors.tail;
        const double weight = priors.noise_px * priors.noise_px * (tail + 1.0) / (tail + off * off);
        if (const int at = static_cast<int>(column[size + i]); at >= 0) {
            total(at, at) += weight / (priors.std[i] * priors.std[i]);
            total(free, at) -= weight * off / priors.std[i];
        }
        cost += priors.noise_px * priors.noise_px * (tail + 1.0) * std::log1p(off * off / tail);
    }
    return cost;
}

System Problem::linearised(State state) {
    const int views = corners.views(), half = rows.shape[1] / 2, last = rows.shape[0] - 1;
    System system;
    system.residuals = Array<double, 2>(corners.pixels.shape[0], 2);
    system.total = Array<double, 2>(free + 1, free + 1);
    system.coupling = Array<double, 3>(views, POSE, free + 1), system.own = Array<double, 3>(views, POSE, POSE);
    for (int view = 0; view < views; ++view) {
        view_rows(state, corners, view, rows);
        for (int n = 0; n < corners.count(view); ++n)
            for (int axis = 0; axis < 2; ++axis)
                system.residuals(corners.first(view) + n, axis) = rows(last, axis * half + n);
        pick(view);
        products(block, picked);
        for (int j = 0; j <= free; ++j) {
            for (int i = j; i <= free; ++i) system.total(i, j) += block(i, j);
            for (int i = 0; i < POSE; ++i) system.coupling(view, i, j) = block(free + 1 + i, j);
        }
        for (int i = 0; i < POSE; ++i)
            for (int j = 0; j <= i; ++j) system.own(view, i, j) = block(free + 1 + i, free + 1 + j);
    }
    system.cost = system.total(free, free) + add_priors(system.total, state);
    system.state = std::move(state);
    return system;
}

Step Problem::step(const System& system, double damping) {
    const int views = corners.views();
    Array<double, 2> reduced = system.total, own(POSE, POSE), shared(free, 1);
    through.values = system.coupling.values;
    Step step;
    for (int i = 0; i < free; ++i) reduced(i, i) *= 1.0 + damping;
    for (int view = 0; view < views; ++view) {
        std::copy(system.own.row(view).begin(), system.own.row(view).end(), own.begin());
        for (int i = 0; i < POSE; ++i) own(i, i) *= 1.0 + damping;
        step.possible &= factored(own, POSE);
        solve_factored(own.view(), through.row(view));
        for (int k = 0; k < POSE; ++k)
            for (int i = 0; i <= free; ++i) {
                const double left = system.coupling(view, k, i);
                for (int j = 0; j <= i; ++j) reduced(i, j) -= left * through(view, k, j);
            }
    }
    std::vector<double> scale(free);
    for (int i = 0; i < free; ++i) {
        scale[i] = 1.0 / std::sqrt(std::max(reduced(i, i), 1e-30));
        shared(i, 0) = scale[i] * reduced(free, i);
        for (int j = 0; j <= i; ++j) reduced(i, j) *= scale[i] * scale[j];
    }
    factored(reduced, free);
    solve_factored(reduced.view(), shared);
    step.shared.resize(free), step.poses = Array<double, 2>(views, POSE);
    for (int i = 0; i < free; ++i) {
        step.shared[i] = scale[i] * shared(i, 0);
        step.promise += system.total(free, i) * step.shared[i];
    }
    for (int view = 0; view < views; ++view)
        for (int k = 0; k < POSE; ++k) {
            double& move = step.poses(view, k);
            move = through(view, k, free);
            for (int i = 0; i < free; ++i) move -= through(view, k, i) * step.shared[i];
            step.promise += system.coupling(view, k, free) * move;
        }
    step.possible &= std::isfinite(step.promise);
    return step;
}

State Problem::moved(const State& state, const Step& step) const {
    State next = state;
    const int size = state.lens.size();
    for (int i = 0; i < column.shape[0]; ++i)
        if (column[i] >= 0) (i < size ? next.lens[i] : next.shape[i - size]) += step.shared[column[i]];
    for (int view = 0; view < corners.views(); ++view) {
        turn_by(step.poses.row(view).data, next.poses.row(view).data);
        for (int i = 3; i < POSE; ++i) next.poses(view, i) += step.poses(view, i);
    }
    return next;
}

// Minimum of the cost, as `core.least_squares.levenberg_marquardt` finds it, except that a step which changes the
// cost by no more than rounding is accepted only where the predicted decrease shrinks.
System Problem::descended(State state, const Rules& rules) {
    System at = linearised(std::move(state));
    double damping = rules.damping;
    for (int iteration = 0; iteration < rules.iterations; ++iteration) {
        const Step next = step(at, damping);
        if (!next.possible) {
            damping *= rules.growth;
            continue;
        }
        // a damped step is short even far from the minimum
        if (next.promise <= rules.tolerance * at.cost && damping < 1.0) break;
        System trial = linearised(moved(at.state, next));
        const double rounding = rules.may_rise_share * at.cost, decrease = at.cost - trial.cost;
        bool better = decrease > rounding, last = false;
        if (!better && decrease >= -rounding) {  // the predicted decrease there decides
            const Step left = step(trial, damping);
            better = left.possible && left.promise < next.promise;
        }
        if (better) {
            at = std::move(trial), damping = std::max(0.1 * damping, LEAST_DAMPING);
            last = rounding < decrease && decrease <= rules.tolerance * at.cost && damping < 1.0;
        } else {
            damping *= rules.growth;
        }
        if (last || damping > MOST_DAMPING) break;
    }
    return at;
}

// Set weights to those of Cauchy's loss for residuals (N, 2), its scale from their median; returns their largest
// change.
double Problem::reweight(ConstMatrix residuals) {
    const int count = residuals.shape[0];
    std::vector<double> lengths(count);
    for (int n = 0; n < count; ++n) lengths[n] = corners.weights[n] * std::hypot(residuals(n, 0), residuals(n, 1));
    std::vector<double> sorted = lengths;
    const double scale = std::max(CAUCHY_PER_MEDIAN * median(sorted), LEAST_PX);
    double change = 0.0;
    for (int n = 0; n < count; ++n) {
        const double own = corners.weights[n], share = lengths[n] / scale, before = weights[n];
        weights[n] = own * own / (1.0 + share * share);
        change = std::max(change, std::abs(weights[n] - before));
    }
    return change;
}

}  // namespace

int unfolding_rows(ConstVector lens, bool fisheye, const Priors& priors, Vector lacking, Matrix by_lens) {
    const double reach = corner_radius(lens, priors.width, priors.height);
    const double furthest = fisheye ? std::min(FURTHEST_PER_CORNER * reach, M_PI) : FURTHEST_PER_CORNER * reach;
    const double scale = priors.stiffness_px / priors.least_slope;
    const int distortions = lens.shape[0] - 4;
    const ConstVector distortion(lens.data + 4, {distortions});
    double highest = -std::numeric_limits<double>::infinity(), curve, slope;
    int count = 0;
    for (int i = 0; i < RADII; ++i) {
        double* row = &by_lens(count, 0);
        std::fill(row, row + 4, 0.0);
        radial_slope(distortion, fisheye, furthest * i / (RADII - 1), curve, slope, {row + 4, {distortions}});
        if (slope < priors.least_slope && (i == 0 || highest < reach)) {  // beyond the picture nothing is required
            lacking[count++] = scale * (priors.least_slope - slope);
            for (int j = 0; j < distortions; ++j) row[4 + j] *= scale;
        }
        highest = std::max(highest, curve);
    }
    return count;
}

bool factored(Matrix matrix, int size) {
    bool whole = true;
    for (int i = 0; i < size; ++i) {
        const double square = matrix(i, i);
        for (int j = 0; j <= i; ++j) {
            double value = matrix(i, j);
            for (int k = 0; k < j; ++k) value -= matrix(i, k) * matrix(j, k);
            const bool there = value > SINGULAR * square;
            if (j == i) whole &= there;
            // the diagonal holds reciprocals
            matrix(i, j) = j < i ? value * matrix(j, j) : there ? 1.0 / std::sqrt(value) : 0.0;
        }
    }
    return whole;
}

double median(std::vector<double>& values) {
    constexpr double INFINITE = std::numeric_limits<double>::infinity();
    if (values.empty()) return INFINITE;
    for (double& value : values) value = value == value ? value : INFINITE;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return values.size() % 2 ? *middle : 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

std::vector<double> descend(State& state, const Corners& corners, Column column, const Priors& priors,
                            const Rules& rules, bool robust) {
    Problem problem(corners, column, priors, state.lens.size());
    bool last = !robust;
    for (int turn = 0;; ++turn) {
        Rules own = rules;
        if (!last) own.iterations = turn > 0 ? FEW : 0, own.tolerance = ROUGH;
        System system = problem.descended(state, own);
        state = std::move(system.state);
        if (last) return {system.residuals.begin(), system.residuals.end()};
        const double change = problem.reweight(system.residuals);
        last = turn == REWEIGHTINGS || (turn > 0 && change < CONVERGED_WEIGHTS);
    }
}

void standardised(ConstMatrix residuals, ConstCube slopes, const bool* used, View<const std::int64_t, 1> bounds,
                  Vector lengths) {
    for (int view = 0; view + 1 < bounds.shape[0]; ++view) {
        const int first = static_cast<int>(bounds[view]), end = static_cast<int>(bounds[view + 1]);
        Array<double, 2> factor(POSE, POSE);
        for (int n = first; n < end; ++n)
            for (int i = 0; i < POSE && used[n]; ++i)
                for (int j = 0; j <= i; ++j)
                    factor(i, j) += slopes(n, 0, i) * slopes(n, 0, j) + slopes(n, 1, i) * slopes(n, 1, j);
        const bool fixed = factored(factor, POSE);
        for (int n = first; n < end; ++n) {
            double half[2][POSE], uu = 0.0, uv = 0.0, vv = 0.0;
            for (int i = 0; i < POSE; ++i) {
                for (int axis = 0; axis < 2; ++axis) {
                    double left = fixed ? slopes(n, axis, i) : 0.0;
                    for (int j = 0; j < i; ++j) left -= factor(i, j) * half[axis][j];
                    half[axis][i] = left * factor(i, i);
                }
                uu += half[0][i] * half[0][i], uv += half[0][i] * half[1][i], vv += half[1][i] * half[1][i];
            }
            const double sign = used[n] ? -1.0 : 1.0, u = residuals(n, 0), v = residuals(n, 1);
            const double middle = 1.0 + 0.5 * sign * (uu + vv), apart = 0.5 * std::hypot(uu - vv, 2.0 * uv);
            const double turn = 0.5 * std::atan2(2.0 * sign * uv, sign * (uu - vv)), c = std::cos(turn),
                         s = std::sin(turn);
            const double along = (u * c + v * s) / std::sqrt(std::max(middle + apart, LEAST_VARIANCE));
            lengths[n] = std::hypot(along, (v * c - u * s) / std::sqrt(std::max(middle - apart, LEAST_VARIANCE)));
        }
    }
}

}  // namespace vbaa::bundle
