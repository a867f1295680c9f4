// Small dense linear algebra: symmetric matrices of a few to a few dozen rows. Rows are whole vectors of LANES.
#pragma once

#include <type_traits>
#include <vector>

#include "arrays.hpp"
#include "lanes.hpp"

namespace vbaa {

// Calls work(std::integral_constant<int, COUNT>, first) for COUNT vectors at a time, at most four, of a row of `wide`
// numbers: additions to several sums do not wait for one another.
template <class Work>
void by_vectors(int wide, Work&& work) {
    int first = 0;
    for (; first + 4 * LANES <= wide; first += 4 * LANES) work(std::integral_constant<int, 4>{}, first);
    switch ((wide - first) / LANES) {
        case 3:
            return work(std::integral_constant<int, 3>{}, first);
        case 2:
            return work(std::integral_constant<int, 2>{}, first);
        case 1:
            return work(std::integral_constant<int, 1>{}, first);
        default:
            return;
    }
}

// Calls work(count, first) for runs of neighbouring vectors among the chosen ones of a row, in order.
template <class Work>
void by_vectors(const std::vector<int>& vectors, Work&& work) {
    for (std::size_t k = 0, next = 0; k < vectors.size(); k = next) {
        do ++next;
        while (next < vectors.size() && vectors[next] == vectors[next - 1] + 1);
        const int begin = vectors[k] * LANES, wide = static_cast<int>(next - k) * LANES;
        by_vectors(wide, [&](auto count, int first) { work(count, begin + first); });
    }
}

// Cholesky's upper factor U (K, K) of an information matrix, `size` rows from `first` on, scaled (K,) to a unit
// diagonal, with damping added. On the diagonal stand one over U's numbers, below it U's transpose. Factor and scale
// are filled from 0 on. Only the upper triangle of the information is read; a matrix that is not positive definite
// gives NaN.
void factorise(ConstMatrix information, int first, int size, double damping, Matrix factor, Vector scale);

// Step (size,) of normal equations that `factorise` has factorised; may be the right side's own place.
void solve_factorised(ConstMatrix factor, ConstVector scale, int size, const double* right_side, double* step);

// The second half of that: from the solution of Uᵀ x = scaled right side, in place.
void solve_upper(ConstMatrix factor, ConstVector scale, int size, double* step);

// The same for right sides (size, C), in place, C a multiple of LANES; half the way where not `whole`.
void solve_many(ConstMatrix factor, ConstVector scale, int size, Matrix sides, bool whole);

// Adds the upper triangle of columnsᵀ · product, both (M, K), to one (K, K): of some vectors of columns, in order.
void add_inner_products(ConstMatrix columns, ConstMatrix product, const std::vector<int>& vectors, Matrix total);

// Eigenvalues, lowest first, and eigenvectors, the columns, by Jacobi's rotations; of 3, 4 or 9 rows. Spoils the
// matrix.
template <int SIZE>
void symmetric_eigen(double (&matrix)[SIZE][SIZE], double (&values)[SIZE], double (&vectors)[SIZE][SIZE]);

}  // namespace vbaa
