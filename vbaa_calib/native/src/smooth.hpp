// A smooth curve through points of which some are wrong, and what goes with it: running means, quantiles, small
// systems of equations. The curve is a cubic B-spline with a penalty on its second differences and Cauchy weights
// (P-splines: Eilers and Marx 1996).
#pragma once

#include <array>
#include <vector>

#include "arrays.hpp"

namespace vbaa {

// Rows of the tabled splines, linear in between: a curve costs no more, however many points it goes through.
constexpr int TABLE = 256;

// Values that a running mean assumes beyond the ends: zeros; the last value; the mirrored values.
enum class Beyond { zeros, end_value, mirrored };

// A fitted curve: its values (N,) at the fitted places, and a table of it over the whole way.
struct SmoothCurve {
    Array<double, 1> values;
    std::array<double, TABLE> table;
};

// Weighted fit at places `share` (N,), fractions of the way, of values (N,) with initial weights (N,), by cubic
// B-splines on so many pieces. One round for each of the scales: the residual at which a point counts half.
// stiffness : of the penalty on bends, as a fraction of the mean weight of a coefficient.
SmoothCurve fit_smooth(ConstVector share, ConstVector values, ConstVector weights, const std::vector<double>& scales,
                       int pieces, double stiffness);

// Values (M,) of the curve at other places (M,), fractions of the way.
Array<double, 1> smooth_at(const SmoothCurve& curve, ConstVector share);

// Solves a small symmetric positive system (M, M) for sides (M, S) by L D Lᵀ. Only the matrix' lower half is read; it
// is replaced, and the solutions take the place of the sides.
void solve_definite(Matrix matrix, Matrix sides);

// Means of `size` neighbours each, for an even size with one more before than after; `means` (N,) must not overlap
// `values`.
void running_mean(ConstVector values, int size, Beyond beyond, Vector means);
Array<double, 1> running_mean(ConstVector values, int size, Beyond beyond);

// Medians (N − size + 1,) and largest (N − size + 1,) of `size` neighbours each, at most N.
Array<double, 1> running_medians(ConstVector values, int size);
Array<double, 1> running_maxima(ConstVector values, int size);

// The number below which a share of values (N,), N > 0, lies. NaN come last.
double quantile(ConstVector values, double share);

// The upper median of values (N,), N > 0.
double median(ConstVector values);

// Linear interpolation of values (N,) at ascending places (N,), N > 0; constant beyond them.
double interpolated(ConstVector places, ConstVector values, double at);

}  // namespace vbaa
