#include "linear_algebra.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>
#include <utility>

namespace vbaa {

namespace {

constexpr double LEAST_DAMPING = 1e-12;  // a direction without information stays where it is
constexpr int SWEEPS = 12;               // of Jacobi's rotations; 4 × 4 are diagonal to the last digit after five

// Subtracts the contributions of the rows above, which have one over their pivots on the diagonal, from row a, in COUNT
// vectors of columns from `first` on. Two sums take every second row each, so that additions do not wait for one
// another.
template <int COUNT>
void eliminate(Matrix factor, int a, int first) {
    const int wide = factor.shape[1];
    Lanes first_sum[COUNT], second[COUNT];
    double* own = &factor(a, first);
    for (int c = 0; c < COUNT; ++c) first_sum[c] = load(own + c * LANES), second[c] = spread(0.0);
    const double *row = factor.data + first, *part = factor.data + a, *inverse = factor.data;
    for (int pair = 0; pair < a / 2; ++pair, row += 2 * wide, part += 2 * wide, inverse += 2 * (wide + 1)) {
        const double one = part[0] * inverse[0], other = part[wide] * inverse[wide + 1];
        for (int c = 0; c < COUNT; ++c) {
            first_sum[c] -= one * load(row + c * LANES);
            second[c] -= other * load(row + wide + c * LANES);
        }
    }
    for (int c = 0; c < COUNT; ++c) {
        if (a % 2) first_sum[c] -= part[0] * inverse[0] * load(row + c * LANES);
        store(own + c * LANES, first_sum[c] + second[c]);
    }
}

// Solves for COUNT vectors of right sides (size, wide), in place.
template <int COUNT>
void solve_columns(ConstMatrix factor, ConstVector scale, int size, double* sides, int wide, bool whole) {
    const auto solved = [&](int k, int first, int last) {
        Lanes row[COUNT];
        double* own = sides + k * wide;
        for (int c = 0; c < COUNT; ++c) row[c] = load(own + c * LANES);
        const double* parts = &factor(k, 0);
        for (int b = first; b < last; ++b) {
            for (int c = 0; c < COUNT; ++c) row[c] -= parts[b] * load(sides + b * wide + c * LANES);
        }
        for (int c = 0; c < COUNT; ++c) store(own + c * LANES, parts[k] * row[c]);
    };
    const auto rescale = [&] {
        for (int k = 0; k < size; ++k) {
            double* own = sides + k * wide;
            for (int c = 0; c < COUNT; ++c) store(own + c * LANES, scale[k] * load(own + c * LANES));
        }
    };
    rescale();
    for (int k = 0; k < size; ++k) solved(k, 0, k);
    if (!whole) return;
    for (int k = size - 1; k >= 0; --k) solved(k, k + 1, size);
    rescale();
}

// Adds LANES × LANES·COUNT inner products of columns from a on with COUNT vectors of the product.
template <int COUNT>
void add_block_of_products(ConstMatrix columns, ConstMatrix product, int a, const int* vectors, Matrix total) {
    Lanes sums[LANES][COUNT] = {};
    for (int j = 0; j < product.shape[0]; ++j) {
        const double* left = &columns(j, a);
        Lanes right[COUNT];
        for (int c = 0; c < COUNT; ++c) right[c] = load(&product(j, vectors[c] * LANES));
        for (int k = 0; k < LANES; ++k) {
            for (int c = 0; c < COUNT; ++c) sums[k][c] += left[k] * right[c];
        }
    }
    for (int k = 0; k < LANES; ++k) {
        for (int c = 0; c < COUNT; ++c) {
            double* to = &total(a + k, vectors[c] * LANES);
            store(to, load(to) + sums[k][c]);
        }
    }
}

// The rotation that makes the entry of rows A and B zero, of a matrix by its upper triangle and of its axes, the rows.
// With indices known to the compiler a small matrix stays in registers.
template <int SIZE, int A, int B>
void rotate(double (&matrix)[SIZE][SIZE], double (&axes)[SIZE][SIZE]) {
    const double twice = 2.0 * matrix[A][B], square = twice * twice;
    if (square == 0.0) return;
    const double apart = matrix[B][B] - matrix[A][A], size = std::abs(apart) + std::sqrt(apart * apart + square);
    const double tangent = (apart < 0.0 ? -twice : twice) / size;
    const double cos = 1.0 / std::sqrt(1.0 + tangent * tangent), sin = tangent * cos;
    const auto turn = [cos, sin](double& first, double& second) {
        const double before = first;
        first = cos * before - sin * second;
        second = sin * before + cos * second;
    };
    matrix[A][A] -= 0.5 * twice * tangent;
    matrix[B][B] += 0.5 * twice * tangent;
    matrix[A][B] = 0.0;
    for (int k = 0; k < A; ++k) turn(matrix[k][A], matrix[k][B]);
    for (int k = A + 1; k < B; ++k) turn(matrix[A][k], matrix[k][B]);
    for (int k = B + 1; k < SIZE; ++k) turn(matrix[A][k], matrix[B][k]);
    for (int k = 0; k < SIZE; ++k) turn(axes[A][k], axes[B][k]);
}

// One rotation for every pair, in the order of a tournament: pairs of one round are independent.
template <int SIZE, int... PAIR>
void rotate_all(double (&matrix)[SIZE][SIZE], double (&axes)[SIZE][SIZE], std::integer_sequence<int, PAIR...>) {
    constexpr int EVEN = (SIZE + 1) / 2, ROUNDS = 2 * EVEN - 1;
    const auto one = [&](auto pair) {
        constexpr int round = pair / EVEN, k = pair % EVEN, first = (round + k) % ROUNDS;
        constexpr int second = k > 0 ? (round + ROUNDS - k) % ROUNDS : ROUNDS;
        if constexpr (second < SIZE) rotate<SIZE, std::min(first, second), std::max(first, second)>(matrix, axes);
    };
    (one(std::integral_constant<int, PAIR>{}), ...);
}

}  // namespace

void factorise(ConstMatrix information, int first, int size, double damping, Matrix factor, Vector scale) {
    const int filled = whole_lanes(size);
    for (int a = 0; a < size; ++a) scale[a] = information(first + a, first + a);
    for (int a = 0; a < size; ++a) scale[a] = scale[a] > 0.0 ? 1.0 / std::sqrt(scale[a]) : 1.0;
    for (int a = 0; a < size; ++a) {
        const double* from = &information(first + a, first);
        double* row = &factor(a, 0);
        for (int b = a / LANES * LANES; b < size; ++b) row[b] = from[b] * scale[a] * scale[b];
        for (int b = size; b < filled; ++b) row[b] = 0.0;
        row[a] += damping + LEAST_DAMPING;
    }
    for (int a = 0; a < size; ++a) {
        const int start = a / LANES * LANES;
        double* row = &factor(a, 0);
        by_vectors(filled - start, [&](auto count, int b) { eliminate<count>(factor, a, start + b); });
        row[a] = row[a] > 0.0 ? 1.0 / row[a] : std::numeric_limits<double>::quiet_NaN();
    }
    // roots come last, where they do not wait for one another
    for (int a = 0; a < size; ++a) {
        double* row = &factor(a, 0);
        const double inverse = std::sqrt(row[a]);
        for (int b = a / LANES * LANES; b < filled; b += LANES) store(row + b, inverse * load(row + b));
        row[a] = inverse;
    }
    for (int a = 1; a < size; ++a) {
        for (int b = 0; b < a; ++b) factor(a, b) = factor(b, a);
    }
}

void solve_factorised(ConstMatrix factor, ConstVector scale, int size, const double* right_side, double* step) {
    for (int a = 0; a < size; ++a) step[a] = right_side[a] * scale[a];
    for (int k = 0; k < size; ++k) {
        const double *row = &factor(k, 0), part = step[k] * row[k];
        step[k] = part;
        for (int b = k + 1; b < size; ++b) step[b] -= row[b] * part;
    }
    solve_upper(factor, scale, size, step);
}

void solve_upper(ConstMatrix factor, ConstVector scale, int size, double* step) {
    for (int k = size - 1; k >= 0; --k) {
        const double *row = &factor(k, 0), part = step[k] * row[k];
        step[k] = part;
        for (int b = 0; b < k; ++b) step[b] -= row[b] * part;
    }
    for (int a = 0; a < size; ++a) step[a] *= scale[a];
}

void solve_many(ConstMatrix factor, ConstVector scale, int size, Matrix sides, bool whole) {
    const int wide = sides.shape[1];
    by_vectors(wide, [&](auto count, int first) {
        solve_columns<count>(factor, scale, size, sides.data + first, wide, whole);
    });
}

void add_inner_products(ConstMatrix columns, ConstMatrix product, const std::vector<int>& vectors, Matrix total) {
    const int count = static_cast<int>(vectors.size());
    for (int k = 0; k < count; ++k) {
        const int a = vectors[k] * LANES;
        int next = k;
        for (; next + 1 < count; next += 2) add_block_of_products<2>(columns, product, a, &vectors[next], total);
        if (next < count) add_block_of_products<1>(columns, product, a, &vectors[next], total);
    }
}

template <int SIZE>
void symmetric_eigen(double (&matrix)[SIZE][SIZE], double (&values)[SIZE], double (&vectors)[SIZE][SIZE]) {
    constexpr int HALF = (SIZE + 1) / 2;
    double axes[SIZE][SIZE] = {};
    int order[SIZE];
    for (int a = 0; a < SIZE; ++a) axes[a][a] = 1.0, order[a] = a;
    for (int sweep = 0; sweep < SWEEPS; ++sweep) {
        double off_diagonal = 0.0, diagonal = 0.0;
        for (int a = 0; a < SIZE; ++a) {
            diagonal += matrix[a][a] * matrix[a][a];
            for (int b = a + 1; b < SIZE; ++b) off_diagonal += matrix[a][b] * matrix[a][b];
        }
        if (!(off_diagonal > 1e-36 * diagonal)) break;
        rotate_all(matrix, axes, std::make_integer_sequence<int, HALF * (2 * HALF - 1)>{});
    }
    std::sort(order, order + SIZE, [&](int a, int b) { return matrix[a][a] < matrix[b][b]; });
    for (int a = 0; a < SIZE; ++a) {
        values[a] = matrix[order[a]][order[a]];
        for (int k = 0; k < SIZE; ++k) vectors[k][a] = axes[order[a]][k];
    }
}

template void symmetric_eigen(double (&)[3][3], double (&)[3], double (&)[3][3]);
template void symmetric_eigen(double (&)[4][4], double (&)[4], double (&)[4][4]);
template void symmetric_eigen(double (&)[9][9], double (&)[9], double (&)[9][9]);

}  // namespace vbaa
