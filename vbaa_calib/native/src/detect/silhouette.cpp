// Blurred Legendre polynomials across a silhouette, and normal equations of profiles in them.
#include "detect/silhouette.hpp"

namespace vbaa::detect {

namespace {

constexpr int K = POLYNOMIALS;
constexpr int EDGES = 16;        // places across a line at which an edge is tried in its place
constexpr int EDGE_PX = 12;      // so far from an edge nothing of its blur is left
constexpr double FAR_STD = 8.0;  // standard deviations beyond the silhouette's edge at which nothing is left of it
constexpr double STEP = 0.02;    // of width and blur, as a part of them, for the derivatives
constexpr double POWERS[K][K] = {{1.0}, {0.0, 1.0}, {-0.5, 0.0, 1.5}, {0.0, -1.5, 0.0, 2.5}};

// (K,) of the table's columns, or their sum weighted by coefficients (K,).
double between(const Table& table, Place at, int k) {
    const double* const near = table.begin() + at.row * K + k;
    return near[0] + at.far * (near[K] - near[0]);
}

double weighted(const Table& table, Place at, const double* coefficients) {
    double sum = 0.0;
    for (int k = 0; k < K; ++k) sum += coefficients[k] * between(table, at, k);
    return sum;
}

// (N, M, M) sums over pixels of the products of every profile's columns, less level and slope of the background. The
// last column are the grey levels; `fill` sets the others, of profile n at pixel t and its place in tables up to row
// `last`.
template <class Fill>
Array<double, 3> products(const Crossings& found, ConstVector base, int last, int several, Fill fill) {
    const int count = found.profiles.shape[0], length = found.profiles.shape[1];
    Array<double, 3> sums(count, several, several);
    Table columns(several, length);
    Numbers across(length);
    for (int n = 0; n < count; ++n) {
        distances(found, n, base[n], across);
        for (int t = 0; t < length; ++t) fill(n, t, Place(across[t], last), columns);
        copy(found.profiles.row(n), columns.row(several - 1));
        remove_background(columns);
        for (int i = 0; i < several; ++i)
            for (int j = 0; j <= i; ++j) sums(n, i, j) = sums(n, j, i) = dot(columns.row(i), columns.row(j));
    }
    return sums;
}

// (R, K) derivative of the blurred polynomials by the logarithm of what one silhouette has more of than another.
Table derivative(const Silhouette& more, const Table& values, int reach_px) {
    Table changed = blurred_polynomials(more, reach_px);
    for (int i = 0; i < values.size(); ++i) changed.values[i] = (changed.values[i] - values.values[i]) / STEP;
    return changed;
}

}  // namespace

// By the recurrence of the powers' convolution with a bell over an interval. Odd ones change sign in the middle.
Table blurred_polynomials(const Silhouette& silhouette, int reach_px) {
    const double half = 0.5 * silhouette.width_px, variance = square(silhouette.blur_px) + square(PIXEL_BLUR_PX);
    const double std = std::sqrt(variance), height = 1.0 / (std::sqrt(2.0 * M_PI) * std);
    const int middle = reach_px * PER_PX;
    Table values(2 * middle + 1, K);
    std::array<double, K> powers, halves;
    for (int k = 0; k < K; ++k) halves[k] = k ? halves[k - 1] * half : 1.0;
    for (int r = 0; r <= middle; ++r) {
        const double across = static_cast<double>(r) / PER_PX, left = (across + half) / std;
        const double right = (across - half) / std;
        if (right > FAR_STD) break;
        const double rising = height * std::exp(-0.5 * left * left), falling = height * std::exp(-0.5 * right * right);
        powers[0] = 0.5 * (std::erfc(-left / std::sqrt(2.0)) - std::erfc(-right / std::sqrt(2.0)));
        for (int k = 0; k < K - 1; ++k) {
            const double before = k ? k * powers[k - 1] : 0.0;
            const double ends = halves[k] * (k % 2 ? falling + rising : falling - rising);
            powers[k + 1] = across * powers[k] + variance * (before - ends);
        }
        for (int k = 0; k < K; ++k) {
            double value = 0.0;
            for (int i = 0; i <= k; ++i) value += POWERS[k][i] * powers[i] / halves[i];
            values(middle + r, k) = value;
            values(middle - r, k) = k % 2 ? -value : value;
        }
    }
    return values;
}

Array<double, 3> normal_equations(const Crossings& found, ConstVector base, const Silhouette& silhouette,
                                  ConstMatrix coefficients, int reach_px) {
    const auto [width_px, blur_px] = silhouette;
    const Table values = blurred_polynomials(silhouette, reach_px), slopes = slopes_of(values);
    const Table wider = derivative({width_px * (1.0 + STEP), blur_px}, values, reach_px);
    const Table softer = derivative({width_px, blur_px * (1.0 + STEP)}, values, reach_px);
    const Numbers share = shares(found);
    Array<double, 3> sums =
        products(found, base, values.shape[0] - 1, COLUMNS, [&](int n, int t, Place at, Table& columns) {
            const double* const own = coefficients.row(n).data;
            for (int k = 0; k < K; ++k) columns(k, t) = between(values, at, k);
            columns(SHAPE, t) = weighted(wider, at, own);
            columns(SHAPE + 1, t) = weighted(softer, at, own);
            columns(SHAPE + 2, t) = columns(SHAPE, t) * (share[n] - 0.5);
            columns(PLACE, t) = weighted(slopes, at, own) * -found.side[n] / found.stretch[n];
        });
    for (int n = 0; n < found.inside.size(); ++n)
        if (!found.inside[n]) fill(sums.row(n), 0.0);
    return sums;
}

Array<double, 3> coefficient_equations(const Crossings& found, ConstVector base, const Table& values) {
    return products(found, base, values.shape[0] - 1, K + 1, [&](int, int t, Place at, Table& columns) {
        for (int k = 0; k < K; ++k) columns(k, t) = between(values, at, k);
    });
}

Numbers explained_by_edges(const Crossings& found, ConstVector base, const Silhouette& silhouette, ConstVector weight,
                           int near) {
    const int count = found.profiles.shape[0], length = found.profiles.shape[1], last = EDGE_PX * PER_PX;
    const double spread = PER_PX * std::sqrt(2.0 * (square(silhouette.blur_px) + square(PIXEL_BLUR_PX)));
    const Numbers table = each(2 * last + 1, [&](int r) { return 0.5 * std::erfc((last - r) / spread); });
    Table sums(count, 2 * EDGES), rows(EDGES + 1, length);  // an edge's square, and its product with the grey levels
    Numbers across(length);
    for (int n = 0; n < count; ++n) {
        distances(found, n, base[n], across);
        copy(found.profiles.row(n), rows.row(EDGES));
        for (int e = 0; e < EDGES; ++e) {
            const double place = (silhouette.width_px + 2.0) * (e / (EDGES - 1.0) - 0.5);
            for (int t = 0; t < length; ++t) {
                const double row = std::rint((across[t] - place) * PER_PX) + last;
                rows(e, t) = table[static_cast<int>(bounded(row, 0.0, 2 * last))];
            }
        }
        remove_background(rows);
        for (int e = 0; e < EDGES; ++e) {
            sums(n, 2 * e) = weight[n] * dot(rows.row(e), rows.row(e));
            sums(n, 2 * e + 1) = weight[n] * dot(rows.row(e), rows.row(EDGES));
        }
    }
    sums = triangle_sums(sums, near);
    return each(count, [&](int n) {
        double most = 0.0;
        for (int e = 0; e < EDGES; ++e)
            most = std::max(most, square(sums(n, 2 * e + 1)) / std::max(sums(n, 2 * e), 1e-9));
        return most;
    });
}

}  // namespace vbaa::detect
