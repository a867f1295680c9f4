#include "scatter.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "order.hpp"
#include "smooth.hpp"

namespace vbaa {
namespace {

double dot(const double* a, const double* b, int count) { return std::inner_product(a, a + count, b, 0.0); }

// The mean of the two middle ones of an even number.
double middle_of(std::vector<double> values) {
    const int count = static_cast<int>(values.size());
    const double upper = nth_smallest(values, count / 2);
    return count % 2 || count == 0 ? upper
                                   : 0.5 * (upper + *std::max_element(values.begin(), values.begin() + count / 2));
}

// Standard deviation of residuals from their median absolute value.
double mad_std(const Array<double, 1>& off) {
    std::vector<double> size(off.size());
    for (int i = 0; i < off.size(); ++i) size[i] = std::abs(off[i]);
    return MAD_SCALE * middle_of(std::move(size));
}

std::vector<int> ascending(const std::vector<double>& values) {
    std::vector<int> order(values.size());
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(),
              [&](int a, int b) { return values[a] < values[b] || (values[a] == values[b] && a < b); });
    return order;
}

// Points of a line, one coordinate after the other, with their standard deviations.
struct Line {
    std::vector<double> u, v, sigma;

    int count() const { return static_cast<int>(u.size()); }
    Line picked(const std::vector<int>& rows) const {
        Line some;
        for (int row : rows) {
            some.u.push_back(u[row]);
            some.v.push_back(v[row]);
            some.sigma.push_back(sigma[row]);
        }
        return some;
    }
};

double extent(const std::vector<double>& values) {
    const auto [least, most] = std::minmax_element(values.begin(), values.end());
    return *most - *least;
}

// Distance of each point from its fourth-nearest neighbour. Along a line the nearest are among the next few in
// the order of one coordinate.
std::vector<double> apart(const Line& line) {
    constexpr int FOURTH = 3;
    const bool by_u = extent(line.u) >= extent(line.v);
    const std::vector<int> order = ascending(by_u ? line.u : line.v);
    const Line ordered = line.picked(order);
    const std::vector<double>& along = by_u ? ordered.u : ordered.v;
    std::vector<double> found(line.count());
    for (int i = 0; i < line.count(); ++i) {
        std::array<double, FOURTH + 1> nearest;
        nearest.fill(INFINITE);
        const auto look = [&](int k) {
            const double gap = along[k] - along[i];
            if (gap * gap > nearest[FOURTH]) return false;
            const double off_u = ordered.u[k] - ordered.u[i], off_v = ordered.v[k] - ordered.v[i];
            double square = off_u * off_u + off_v * off_v;
            for (double& each : nearest)
                if (square < each) std::swap(square, each);
            return true;
        };
        for (int k = i - 1; k >= 0 && look(k);) --k;
        for (int k = i + 1; k < line.count() && look(k);) ++k;
        found[order[i]] = std::sqrt(nearest[FOURTH]);
    }
    return found;
}

// Points without lonely ones, in order along their principal axis: `u` along it, `v` across, the same way round in all
// lines.
Line along_axis(const Line& line, const ScatterSettings& settings) {
    const std::vector<double> distances = apart(line);
    const double most = settings.lonely * middle_of(distances);
    std::vector<int> near;
    for (int i = 0; i < line.count(); ++i) {
        if (distances[i] <= most) near.push_back(i);
    }
    Line some = line.picked(near);
    const double by_count = 1.0 / some.count();
    const double mean_u = by_count * std::accumulate(some.u.begin(), some.u.end(), 0.0);
    const double mean_v = by_count * std::accumulate(some.v.begin(), some.v.end(), 0.0);
    double uu = 0.0, uv = 0.0, vv = 0.0;
    for (int i = 0; i < some.count(); ++i) {
        const double off_u = some.u[i] -= mean_u, off_v = some.v[i] -= mean_v;
        uu += off_u * off_u, uv += off_u * off_v, vv += off_v * off_v;
    }
    const double angle = 0.5 * std::atan2(2.0 * uv, uu - vv);
    double cos = std::cos(angle), sin = std::sin(angle);
    if ((std::abs(sin) > std::abs(cos) ? sin : cos) < 0.0) cos = -cos, sin = -sin;
    for (int i = 0; i < some.count(); ++i) {
        const double u = some.u[i], v = some.v[i];
        some.u[i] = cos * u + sin * v, some.v[i] = cos * v - sin * u;
    }
    return some.picked(ascending(some.u));
}

// Orthonormal basis (K, N) of cubic splines over the points' standard deviations, with as many points between any two
// knots, and its derivatives along the line times these.
struct Basis {
    Array<double, 2> values, slopes;
};

Basis basis_of(const Line& line, const ScatterSettings& settings) {
    const int count = line.count();
    if (count < settings.scatter_points || !(line.u.back() > line.u.front())) return {};
    const int intervals = std::min(settings.intervals, count / settings.per_interval), size = 3 + intervals;
    const double half = 0.5 * (line.u.back() - line.u.front());
    const double middle = std::accumulate(line.u.begin(), line.u.end(), 0.0) / count;
    Basis made = {Array<double, 2>(size, count), Array<double, 2>(size, count)};
    for (int k = 0; k < size; ++k) {
        const double place = (k - 3) * (count - 1.0) / intervals, before = std::floor(std::max(place, 0.0));
        const auto node = static_cast<int>(before);
        const double share = place - before;
        const double knot = k > 3 ? (1.0 - share) * line.u[node] + share * line.u[node + 1] - middle : 0.0;
        const int power = std::min(k, 3);
        for (int i = 0; i < count; ++i) {
            const double at = (line.u[i] - middle - knot) / half, from = k > 3 ? std::max(at, 0.0) : at;
            double below = 1.0;
            for (int n = 1; n < power; ++n) below *= from;
            made.values(k, i) = (power ? below * from : 1.0) / line.sigma[i];
            made.slopes(k, i) = power * below / half;
        }
    }
    // Gram and Schmidt's, twice for the rounding
    for (int k = 0; k < size; ++k) {
        double *own = made.values.row(k).begin(), *slope = made.slopes.row(k).begin();
        const double whole = dot(own, own, count);
        for (int turn = 0; turn < 2; ++turn) {
            for (int other = 0; other < k; ++other) {
                const double *by = made.values.row(other).begin(), *slope_by = made.slopes.row(other).begin();
                const double part = dot(own, by, count);
                for (int i = 0; i < count; ++i) own[i] -= part * by[i], slope[i] -= part * slope_by[i];
            }
        }
        // what the columns before leave of one that adds nothing
        constexpr double rounding = 1e-20;
        const double left = dot(own, own, count), by_size = left > rounding * whole ? 1.0 / std::sqrt(left) : 0.0;
        for (int i = 0; i < count; ++i) own[i] *= by_size, slope[i] *= by_size;
    }
    return made;
}

// Distances of the points from the curve that fits them best with these weights.
Array<double, 1> off_curve(const Line& line, const Basis& basis, const std::vector<double>& weights) {
    const auto& [values, slopes] = basis;
    const int size = values.shape[0], count = line.count();
    Array<double, 2> information(size, size), side(size, 1);
    Array<double, 1> seen(count), weighted(count), rise(count);
    for (int i = 0; i < count; ++i) seen[i] = line.v[i] / line.sigma[i];
    for (int a = 0; a < size; ++a) {
        const double* own = values.row(a).begin();
        for (int i = 0; i < count; ++i) weighted[i] = own[i] * weights[i] * weights[i];
        side(a, 0) = dot(weighted.begin(), seen.begin(), count);
        for (int b = 0; b <= a; ++b) information(a, b) = dot(weighted.begin(), values.row(b).begin(), count);
        if (!(information(a, a) > 0.0)) information(a, a) = 1.0;
    }
    solve_definite(information, side);
    for (int a = 0; a < size; ++a) {
        const double *own = values.row(a).begin(), *slope = slopes.row(a).begin();
        for (int i = 0; i < count; ++i) seen[i] -= own[i] * side(a, 0), rise[i] += slope[i] * side(a, 0);
    }
    for (int i = 0; i < count; ++i) seen[i] /= std::sqrt(1.0 + rise[i] * rise[i]);
    return seen;
}

double largest(const Array<double, 1>& off) {
    double most = 0.0;
    for (double each : off) most = std::max(most, std::abs(each));
    return most;
}

}  // namespace

AboutCurve about_curve(ConstMatrix points, ConstVector sigma, const ScatterSettings& settings) {
    Line line;
    for (int i = 0; i < points.shape[0]; ++i) {
        if (!std::isfinite(points(i, 0)) || !std::isfinite(points(i, 1))) continue;
        line.u.push_back(points(i, 0));
        line.v.push_back(points(i, 1));
        line.sigma.push_back(sigma[i]);
    }
    if (line.count() < settings.scatter_points) return {};
    line = along_axis(line, settings);
    Basis basis = basis_of(line, settings);
    std::vector<double> weights(line.count(), 1.0);
    Array<double, 1> off;
    for (int turn = 0; turn < settings.rounds; ++turn) {
        if (basis.values.size() == 0) return {};
        off = off_curve(line, basis, weights);
        const double scatter = std::max(mad_std(off), 1e-9);
        const bool many = off.size() >= settings.surely_points;
        if (turn == 0 && many && largest(off) <= settings.surely_std * scatter) break;
        if (turn < settings.rounds - 2) {
            // what lies far off counts less and less
            for (int i = 0; i < off.size(); ++i) weights[i] = 1.0 / std::hypot(1.0, off[i] / scatter);
        } else if (turn < settings.rounds - 1) {
            std::vector<int> kept;
            for (int i = 0; i < off.size(); ++i) {
                if (std::abs(off[i]) <= settings.gross_std * scatter) kept.push_back(i);
            }
            if (static_cast<int>(kept.size()) < line.count()) {
                line = line.picked(kept);
                basis = basis_of(line, settings);
            }
            weights.assign(line.count(), 1.0);
        }
    }
    return {std::move(off), std::move(basis.values)};
}

double scatter_about(const std::vector<AboutCurve>& lines, const ScatterSettings& settings) {
    std::vector<double> scatters;
    std::vector<Array<double, 1>> even;  // each in its own scatter, and none of it large: no gross error counts
    double count = 0.0;
    for (const AboutCurve& line : lines) {
        scatters.push_back(mad_std(line.off));
        const double by_scatter = 1.0 / std::max(scatters.back(), 1e-9);
        even.push_back(line.off);
        for (double& each : even.back()) each = std::min(std::max(each * by_scatter, -3.0), 3.0);
        count += line.off.size();
    }
    const double scatter = middle_of(scatters);
    if (!(scatter > 0.0)) return scatter;
    // covariance of residuals `lag` points apart, and the part of a slow error's covariance that the curves absorb
    const auto covariance_at = [&](int lag, double& taken) {
        double total = 0.0;
        taken = 0.0;
        for (std::size_t k = 0; k < lines.size(); ++k) {
            const Array<double, 2>& basis = lines[k].basis;
            const int left = std::max(even[k].size() - lag, 0);
            total += dot(even[k].begin() + lag, even[k].begin(), left);
            double own = 0.0;
            for (int a = 0; a < basis.shape[0]; ++a) own += dot(basis.row(a).begin() + lag, basis.row(a).begin(), left);
            taken += own / even[k].size() / static_cast<double>(lines.size());
        }
        return total / count;
    };
    double by_curve = 0.0;
    const double variance = covariance_at(0, by_curve);
    double total = variance, left = 1.0 - by_curve, density = total / left, own = density;
    for (int lag = 1; lag <= settings.lags; ++lag) {
        double taken = 0.0;
        const double covariance = covariance_at(lag, taken), correlation = (covariance + density * taken) / own;
        if (correlation < settings.significant / std::sqrt(count) || left - 2.0 * taken < settings.slow) break;
        total += 2.0 * covariance, left -= 2.0 * taken;
        density = total / left;
        own = variance + density * by_curve;
    }
    return scatter * std::sqrt(density / variance);
}

}  // namespace vbaa
