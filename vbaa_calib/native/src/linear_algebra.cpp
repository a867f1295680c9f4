#include "linear_algebra.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace vbaa {

namespace {

constexpr double LEAST_DAMPING = 1e-12;  // a direction without information stays where it is
constexpr int SWEEPS = 12;               // of Jacobi's rotations; 4 × 4 are diagonal to the last digit after five
constexpr int BLOCK = 4;  // vectors that are worked on next to each other: one alone would wait for itself

// Row a of the factor, COUNT vectors from column b on: what the rows above leave of it.
template <int COUNT>
void eliminate(double* rows, int wide, int a, int b) {
    Lanes left[COUNT];
    double* own = rows + a * wide + b;
    for (int k = 0; k < COUNT; ++k) left[k] = load(own + k * LANES);
    const double *row = rows + b, *part = rows + a;
    for (int above = 0; above < a; ++above, row += wide, part += wide) {
        for (int k = 0; k < COUNT; ++k) left[k] -= *part * load(row + k * LANES);
    }
    for (int k = 0; k < COUNT; ++k) store(own + k * LANES, left[k]);
}

// COUNT vectors of right sides, from a column on, in place.
template <int COUNT>
void solve_columns(ConstMatrix factor, ConstVector scale, int size, double* sides, int wide, bool whole) {
    Lanes row[COUNT];
    for (int k = 0; k < size; ++k) {
        double* own = sides + k * wide;
        for (int c = 0; c < COUNT; ++c) row[c] = scale[k] * load(own + c * LANES);
        for (int b = 0; b < k; ++b) {
            for (int c = 0; c < COUNT; ++c) row[c] -= factor(b, k) * load(sides + b * wide + c * LANES);
        }
        const double inverse = 1.0 / factor(k, k);
        for (int c = 0; c < COUNT; ++c) store(own + c * LANES, inverse * row[c]);
    }
    if (!whole) return;
    for (int k = size - 1; k >= 0; --k) {
        double* own = sides + k * wide;
        for (int c = 0; c < COUNT; ++c) row[c] = load(own + c * LANES);
        for (int b = k + 1; b < size; ++b) {
            for (int c = 0; c < COUNT; ++c) row[c] -= factor(k, b) * load(sides + b * wide + c * LANES);
        }
        const double inverse = 1.0 / factor(k, k);
        for (int c = 0; c < COUNT; ++c) store(own + c * LANES, inverse * row[c]);
    }
    for (int k = 0; k < size; ++k) {
        for (int c = 0; c < COUNT; ++c)
            store(sides + k * wide + c * LANES, scale[k] * load(sides + k * wide + c * LANES));
    }
}

// LANES × LANES·COUNT inner products of columns from a on with those of the product from b on.
template <int COUNT>
void block_of_products(ConstMatrix columns, ConstMatrix product, int a, int b, Matrix total) {
    Lanes sums[LANES][COUNT] = {};
    for (int j = 0; j < product.shape[0]; ++j) {
        const double *left = &columns(j, a), *right = &product(j, b);
        for (int k = 0; k < LANES; ++k) {
            for (int c = 0; c < COUNT; ++c) sums[k][c] += left[k] * load(right + c * LANES);
        }
    }
    for (int k = 0; k < LANES; ++k) {
        for (int c = 0; c < COUNT; ++c) store(&total(a + k, b + c * LANES), sums[k][c]);
    }
}

// The rotation that makes one pair of entries zero.
void rotate(Matrix matrix, Matrix vectors, int a, int b) {
    const double off_diagonal = matrix(a, b);
    const int size = matrix.shape[0];
    if (off_diagonal == 0.0) return;
    const double half = (matrix(b, b) - matrix(a, a)) / (2.0 * off_diagonal);
    const double size_of_tangent = 1.0 / (std::abs(half) + std::sqrt(1.0 + half * half));
    const double tangent = half < 0.0 ? -size_of_tangent : size_of_tangent;
    const double cos = 1.0 / std::sqrt(1.0 + tangent * tangent), sin = tangent * cos;
    const auto turn = [&](double& first, double& second) {
        const double before = first;
        first = cos * before - sin * second;
        second = sin * before + cos * second;
    };
    for (int k = 0; k < size; ++k) turn(matrix(k, a), matrix(k, b));
    for (int k = 0; k < size; ++k) turn(matrix(a, k), matrix(b, k));
    for (int k = 0; k < size; ++k) turn(vectors(k, a), vectors(k, b));
}

}  // namespace

void factorise(ConstMatrix information, int first, int size, double damping, Matrix factor, Vector scale) {
    const int filled = whole_lanes(size), wide = factor.shape[1];
    for (int a = 0; a < size; ++a) {
        const double own = information(first + a, first + a);
        scale[a] = own > 0.0 ? 1.0 / std::sqrt(own) : 1.0;
    }
    for (int a = 0; a < size; ++a) {
        double* row = &factor(a, 0);
        for (int b = a / LANES * LANES; b < size; ++b) row[b] = information(first + a, first + b) * scale[a] * scale[b];
        for (int b = size; b < filled; ++b) row[b] = 0.0;
        row[a] += damping + LEAST_DAMPING;
        int b = a / LANES * LANES;
        for (; b + BLOCK * LANES <= filled; b += BLOCK * LANES) eliminate<BLOCK>(factor.data, wide, a, b);
        for (; b + 2 * LANES <= filled; b += 2 * LANES) eliminate<2>(factor.data, wide, a, b);
        for (; b < filled; b += LANES) eliminate<1>(factor.data, wide, a, b);
        const double inverse = row[a] > 0.0 ? 1.0 / std::sqrt(row[a]) : std::numeric_limits<double>::quiet_NaN();
        for (b = a / LANES * LANES; b < filled; b += LANES) store(row + b, inverse * load(row + b));
    }
}

void solve_factorised(ConstMatrix factor, ConstVector scale, int size, const double* right_side, double* step) {
    for (int a = 0; a < size; ++a) step[a] = right_side[a] * scale[a];
    for (int k = 0; k < size; ++k) {
        const double *row = &factor(k, 0), part = step[k] / row[k];
        step[k] = part;
        for (int b = k + 1; b < size; ++b) step[b] -= row[b] * part;
    }
    for (int k = size - 1; k >= 0; --k) {
        const double* row = &factor(k, 0);
        double total = step[k];
        for (int b = k + 1; b < size; ++b) total -= row[b] * step[b];
        step[k] = total / row[k];
    }
    for (int a = 0; a < size; ++a) step[a] *= scale[a];
}

void solve_many(ConstMatrix factor, ConstVector scale, int size, Matrix sides, bool whole) {
    const int wide = sides.shape[1];
    int first = 0;
    for (; first + BLOCK * LANES <= wide; first += BLOCK * LANES) {
        solve_columns<BLOCK>(factor, scale, size, sides.data + first, wide, whole);
    }
    for (; first + 2 * LANES <= wide; first += 2 * LANES) {
        solve_columns<2>(factor, scale, size, sides.data + first, wide, whole);
    }
    for (; first < wide; first += LANES) solve_columns<1>(factor, scale, size, sides.data + first, wide, whole);
}

void inner_products(ConstMatrix columns, ConstMatrix product, Matrix total) {
    for (int a = 0; a < total.shape[0]; a += LANES) {
        int b = 0;
        for (; b + LANES <= a; b += 2 * LANES) block_of_products<2>(columns, product, a, b, total);
        for (; b <= a; b += LANES) block_of_products<1>(columns, product, a, b, total);
    }
}

void symmetric_eigen(Matrix matrix, Vector values, Matrix vectors) {
    const int size = values.shape[0];
    fill(vectors, 0.0);
    for (int a = 0; a < size; ++a) vectors(a, a) = 1.0;
    for (int sweep = 0; sweep < SWEEPS; ++sweep) {
        double off_diagonal = 0.0, diagonal = 0.0;
        for (int a = 0; a < size; ++a) {
            diagonal += matrix(a, a) * matrix(a, a);
            for (int b = 0; b < a; ++b) off_diagonal += matrix(a, b) * matrix(a, b);
        }
        if (!(off_diagonal > 1e-36 * diagonal)) break;
        for (int a = 0; a < size - 1; ++a) {
            for (int b = a + 1; b < size; ++b) rotate(matrix, vectors, a, b);
        }
    }
    for (int a = 0; a < size; ++a) values[a] = matrix(a, a);
    for (int a = 0; a < size - 1; ++a) {
        int least = a;
        for (int b = a + 1; b < size; ++b) {
            if (values[b] < values[least]) least = b;
        }
        if (least == a) continue;
        std::swap(values[a], values[least]);
        for (int k = 0; k < size; ++k) std::swap(vectors(k, a), vectors(k, least));
    }
}

}  // namespace vbaa
