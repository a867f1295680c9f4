// An antenna with its own reflectance: bare steel, or a highlight at its side; bright here, dark there, as its
// background there. Across the antenna it is a polynomial that ends at the silhouette's two edges, at a distance known
// from the rig, seen through blur and pixel. Its coefficients change smoothly along the antenna and may have either
// sign, so that bright goes over into dark through zero. Only edges locate the line: where one of them is not visible,
// a lopsided reflectance looks like a line with an offset, for as long as the light stays the same. That much the place
// is uncertain, alike for many neighbours.
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

// Cross-sections of N profiles.
struct Reflectance {
    Silhouette silhouette;
    Table coefficients;    // (N, K) of Legendre polynomials across it, grey levels above the background
    Numbers height;        // (N,) contrast to the background, grey levels: root mean square over the silhouette
    CrossSection section;  // the cross-sections over their heights: the blurred polynomials, weighted
};

// What N profiles show.
struct LearnedReflectance {
    Reflectance reflectance;
    Numbers course;     // (N,) the line's along the profiles, px
    Numbers shared_px;  // (N,) deviation of the course, across the line, which neighbours share
    double taper;       // part by which the line is broader at the path's end
    Flags none;         // (N,) where there is no line
    Numbers sure;       // (N,) how surely there is one: 1 where an edge does not explain the profiles
};

// Where along the profiles the line is known to lie, (N,), and the deviation of that, px; empty where not known.
struct KnownCourse {
    Numbers course;
    double std_px = 0.0;
};

// A path (K, 2) as smooth as an antenna: on bare metal a highlight that changes sides leads it to and fro.
Table stiffened(ConstMatrix path_px);

// The mean cross-section, over its height, of profiles (M,).
CrossSection mean_shape(const Reflectance& reflectance, const std::vector<int>& which);

// The reflectance that profiles about a path show, and where the line is. Width and blur of the whole line, its course
// and the coefficients at every place are solved for together, from some of the profiles; then the coefficients from
// all of them.
LearnedReflectance learn_reflectance(const Crossings& found, const Silhouette& initial, const KnownCourse& known);

}  // namespace vbaa::detect
