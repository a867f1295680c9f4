// What a silhouette of known width shows: polynomials across it, blurred, and what profiles say of them and of it.
#pragma once

#include "detect/line_shape.hpp"

namespace vbaa::detect {

// Legendre polynomials that an antenna's reflectance across it is made of: level, brighter on one side, a highlight,
// and that on one side.
constexpr int POLYNOMIALS = 4;
constexpr std::array<double, POLYNOMIALS> MEAN_SQUARE = {1.0, 1.0 / 3.0, 1.0 / 5.0, 1.0 / 7.0};  // over the silhouette

// Columns of a profile's normal equations: coefficients; width, blur and taper; place; grey levels.
constexpr int SHAPE = POLYNOMIALS, PLACE = SHAPE + 3, LEVELS = PLACE + 1, COLUMNS = LEVELS + 1;

struct Silhouette {
    double width_px, blur_px;
};

// (R, K) Legendre polynomials over the silhouette, blurred, at a table's distances from its centre.
Table blurred_polynomials(const Silhouette& silhouette, int reach_px);

// (N, K + 5, K + 5) products of every profile's columns, for lines at (N,) with coefficients (N, K).
Array<double, 3> normal_equations(const Crossings& found, ConstVector base, const Silhouette& silhouette,
                                  ConstMatrix coefficients, int reach_px);

// (N, K + 1, K + 1) the same of coefficients and grey levels only, for polynomials tabled (R, K).
Array<double, 3> coefficient_equations(const Crossings& found, ConstVector base, const Table& values);

// (N,) weighted squares of `near` profiles that one blurred edge explains, in place of a line at (N,) and wherever
// across it. weight : (N,) of the profiles.
Numbers explained_by_edges(const Crossings& found, ConstVector base, const Silhouette& silhouette, ConstVector weight,
                           int near);

}  // namespace vbaa::detect
