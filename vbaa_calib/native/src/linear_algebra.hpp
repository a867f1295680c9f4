// Small dense linear algebra: symmetric matrices of a few to a few dozen rows. Rows are whole vectors of LANES.
#pragma once

#include "arrays.hpp"
#include "lanes.hpp"

namespace vbaa {

// Cholesky's upper factor (K, K) of an information matrix, `size` rows from `first` on, scaled (K,) to a unit diagonal,
// with damping added; factor and scale are filled from 0 on. What is not a positive matrix gives NaN.
void factorise(ConstMatrix information, int first, int size, double damping, Matrix factor, Vector scale);

// Step (size,) of normal equations that `factorise` has factorised; may be the right side's own place.
void solve_factorised(ConstMatrix factor, ConstVector scale, int size, const double* right_side, double* step);

// The same for right sides (size, C), in place, C a multiple of LANES; half the way where not `whole`.
void solve_many(ConstMatrix factor, ConstVector scale, int size, Matrix sides, bool whole);

// The lower triangle (K, K) of columnsᵀ · product, both (M, K).
void inner_products(ConstMatrix columns, ConstMatrix product, Matrix total);

// Eigenvalues (K,), lowest first, and eigenvectors, the columns (K, K), by Jacobi's rotations. Spoils the matrix.
void symmetric_eigen(Matrix matrix, Vector values, Matrix vectors);

}  // namespace vbaa
