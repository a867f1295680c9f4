#include "smooth.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace vbaa {
namespace {

// The four cubic B-splines that are not zero in each row of the table, and which is the first of them.
struct Splines {
    std::array<int, TABLE> first;
    std::array<std::array<double, 4>, TABLE> values;

    explicit Splines(int pieces) {
        for (int row = 0; row < TABLE; ++row) {
            const double place = row * (pieces / (TABLE - 1.0));
            first[row] = std::min(static_cast<int>(place), pieces - 1);
            const double t = place - first[row], s = 1.0 - t;
            values[row] = {s * s * s / 6.0, ((3.0 * t - 6.0) * t * t + 4.0) / 6.0,
                           (((-3.0 * t + 3.0) * t + 3.0) * t + 1.0) / 6.0, t * t * t / 6.0};
        }
    }
};

// Row of the table before a place in [0, 1], and the part of the way to the next.
struct Place {
    int row = 0;
    double part = 0.0;

    Place() = default;
    explicit Place(double share) {
        const double place = std::min(std::max(0.0, share), 1.0) * (TABLE - 1);
        row = std::min(static_cast<int>(place), TABLE - 2);
        part = place - row;
    }
    double of(const std::array<double, TABLE>& table) const {
        return table[row] + (table[row + 1] - table[row]) * part;
    }
};

// (unknowns, 4) lower band, the diagonal first, of the sum of the coefficients' squared second differences.
void bending(double stiffness, Matrix band) {
    constexpr double weight[3] = {1.0, -2.0, 1.0};
    fill(band, 0.0);
    for (int i = 0; i < band.shape[0]; ++i) band(i, 0) = 1e-9;
    for (int k = 0; k < band.shape[0] - 2; ++k)
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j <= i; ++j) band(k + i, i - j) += stiffness * weight[i] * weight[j];
}

// Solves a symmetric system with the lower band (M, 4) by L D Lᵀ; the solution replaces the side (M,).
void solve_band(Matrix band, Vector side) {
    const int count = side.shape[0];
    for (int i = 0; i < count; ++i) {
        const int before = std::min(3, i);
        for (int k = before; k > 0; --k) {  // column i − k
            for (int m = k + 1; m <= before; ++m) band(i, k) -= band(i, m) * band(i - k, m - k) * band(i - m, 0);
            band(i, k) /= band(i - k, 0);
        }
        for (int k = 1; k <= before; ++k) {
            band(i, 0) -= band(i, k) * band(i, k) * band(i - k, 0);
            side(i) -= band(i, k) * side(i - k);
        }
    }
    for (int i = 0; i < count; ++i) side(i) /= band(i, 0);
    for (int i = count - 1; i >= 0; --i)
        for (int k = 1; k < std::min(4, count - i); ++k) side(i) -= band(i + k, k) * side(i + k);
}

double beyond_ends(ConstVector values, int place, Beyond beyond) {
    const int count = values.shape[0];
    if (place >= 0 && place < count) return values[place];
    if (beyond == Beyond::zeros) return 0.0;
    if (beyond == Beyond::end_value) return values[std::clamp(place, 0, count - 1)];
    const int folded = (place % (2 * count) + 2 * count) % (2 * count);
    return values[std::min(folded, 2 * count - 1 - folded)];
}

}  // namespace

SmoothCurve fit_smooth(ConstVector share, ConstVector values, ConstVector weights, const std::vector<double>& scales,
                       int pieces, double stiffness) {
    const int count = share.shape[0], unknowns = pieces + 3;
    const Splines splines(pieces);
    std::vector<Place> places(count);
    double whole = 0.0;
    for (int n = 0; n < count; ++n) places[n] = Place(share[n]), whole += weights[n];
    SmoothCurve curve{Array<double, 1>(Unset{}, count), {}};
    Array<double, 1> trusted(weights), side(unknowns);
    Array<double, 2> band(unknowns, 4);
    for (const double scale : scales) {
        std::array<double, TABLE> total{}, summed{};
        for (int n = 0; n < count; ++n) {
            const auto [row, part] = places[n];
            const double near = trusted[n] * (1.0 - part), far = trusted[n] * part;
            total[row] += near;
            total[row + 1] += far;
            summed[row] += near * values[n];
            summed[row + 1] += far * values[n];
        }
        bending(stiffness * (whole / unknowns + 1e-12), band);
        fill(side.view(), 0.0);
        for (int row = 0; row < TABLE; ++row) {
            const auto& spline = splines.values[row];
            const int first = splines.first[row];
            for (int i = 0; i < 4; ++i) {
                side[first + i] += summed[row] * spline[i];
                for (int j = 0; j <= i; ++j) band(first + i, i - j) += total[row] * spline[i] * spline[j];
            }
        }
        solve_band(band, side);
        for (int row = 0; row < TABLE; ++row) {
            curve.table[row] = 0.0;
            for (int i = 0; i < 4; ++i) curve.table[row] += splines.values[row][i] * side[splines.first[row] + i];
        }
        for (int n = 0; n < count; ++n) {
            curve.values[n] = places[n].of(curve.table);
            const double off = (values[n] - curve.values[n]) / scale;
            trusted[n] = weights[n] / (1.0 + off * off);
        }
    }
    return curve;
}

Array<double, 1> smooth_at(const SmoothCurve& curve, ConstVector share) {
    Array<double, 1> values(Unset{}, share.shape[0]);
    for (int n = 0; n < values.size(); ++n) values[n] = Place(share[n]).of(curve.table);
    return values;
}

void solve_definite(Matrix matrix, Matrix sides) {
    const int count = sides.shape[0], several = sides.shape[1];
    const auto subtract = [&](int i, double factor, int k) {
        double* const to = sides.row(i).data;
        const double* const from = sides.row(k).data;
        for (int s = 0; s < several; ++s) to[s] -= factor * from[s];
    };
    for (int i = 0; i < count; ++i) {
        for (int j = 0; j < i; ++j) {
            for (int k = 0; k < j; ++k) matrix(i, j) -= matrix(i, k) * matrix(j, k) * matrix(k, k);
            matrix(i, j) /= matrix(j, j);
        }
        for (int k = 0; k < i; ++k) {
            matrix(i, i) -= matrix(i, k) * matrix(i, k) * matrix(k, k);
            subtract(i, matrix(i, k), k);
        }
    }
    for (int i = count - 1; i >= 0; --i) {
        double* const to = sides.row(i).data;
        const double pivot = matrix(i, i);
        for (int s = 0; s < several; ++s) to[s] /= pivot;
        for (int k = i + 1; k < count; ++k) subtract(i, matrix(k, i), k);
    }
}

void running_mean(ConstVector values, int size, Beyond beyond, Vector means) {
    const int count = values.shape[0], before = size / 2, after = size - size / 2;
    if (count == 0) return;
    double total = 0.0;
    for (int k = -before; k < after; ++k) total += beyond_ends(values, k, beyond);
    for (int n = 0; n < count; ++n) {
        means[n] = total / size;
        const bool within = n >= before && n + after < count;
        total += within ? values[n + after] - values[n - before]
                        : beyond_ends(values, n + after, beyond) - beyond_ends(values, n - before, beyond);
    }
}

Array<double, 1> running_mean(ConstVector values, int size, Beyond beyond) {
    Array<double, 1> means(Unset{}, values.shape[0]);
    running_mean(values, size, beyond, means);
    return means;
}

Array<double, 1> running_medians(ConstVector values, int size) {
    Array<double, 1> medians(values.size() - size + 1);
    std::vector<double> sorted(values.begin(), values.begin() + size);
    std::sort(sorted.begin(), sorted.end());
    for (int i = 0; i < medians.size(); ++i) {
        if (i > 0) {
            sorted.erase(std::lower_bound(sorted.begin(), sorted.end(), values[i - 1]));
            const double next = values[i + size - 1];
            sorted.insert(std::upper_bound(sorted.begin(), sorted.end(), next), next);
        }
        medians[i] = 0.5 * (sorted[(size - 1) / 2] + sorted[size / 2]);
    }
    return medians;
}

Array<double, 1> running_maxima(ConstVector values, int size) {
    Array<double, 1> maxima(values.size() - size + 1);
    for (int i = 0; i < maxima.size(); ++i) {
        maxima[i] = *std::max_element(values.begin() + i, values.begin() + i + size);
    }
    return maxima;
}

double quantile(ConstVector values, double share) {
    const int count = values.shape[0], place = std::min(static_cast<int>(share * count), count - 1);
    Array<double, 1> rest(Unset{}, count);
    int known = 0;
    double least = std::numeric_limits<double>::infinity(), most = -least;
    for (const double each : values) {
        rest[known] = each;
        known += each == each;
        least = std::min(each, least), most = std::max(each, most);
    }
    if (place < 0 || place >= known) return std::numeric_limits<double>::quiet_NaN();
    constexpr int many = 128, bins = 256;  // numbers from which bins are counted first, and bins
    int before = 0;
    if (known >= many && most - least < std::numeric_limits<double>::infinity() && most > least) {
        // only those of its bin are sorted
        std::array<int, bins> counts{};
        const double scale = (bins - 1) / (most - least);
        const auto bin = [&](double value) { return static_cast<int>((value - least) * scale); };
        for (int n = 0; n < known; ++n) ++counts[bin(rest[n])];
        int own = 0;
        while (before + counts[own] <= place) before += counts[own++];
        int within = 0;
        for (int n = 0; n < known; ++n) {
            const double each = rest[n];
            rest[within] = each;
            within += bin(each) == own;
        }
        known = within;
    }
    std::nth_element(rest.begin(), rest.begin() + place - before, rest.begin() + known);
    return rest[place - before];
}

double median(ConstVector values) { return quantile(values, 0.5); }

double interpolated(ConstVector places, ConstVector values, double at) {
    const int after = static_cast<int>(std::upper_bound(places.begin(), places.end(), at) - places.begin());
    if (after == 0) return values[0];
    if (after == places.shape[0]) return values[after - 1];
    const double part = (at - places[after - 1]) / (places[after] - places[after - 1]);
    return values[after - 1] + part * (values[after] - values[after - 1]);
}

}  // namespace vbaa
