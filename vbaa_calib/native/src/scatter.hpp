// How far a line's points lie from a smooth curve through them.
#pragma once

#include "arrays.hpp"

namespace vbaa {

// See `OutlierSettings` in Python.
struct ScatterSettings {
    int scatter_points, rounds, surely_points, intervals, per_interval, lags;
    double lonely, gross_std, surely_std, significant, slow;
};

// Distances (M,) of points from a curve, in standard deviations, in order; and the curve's orthonormal basis (K, M).
struct AboutCurve {
    Array<double, 1> off;
    Array<double, 2> basis;
};

// Points (N, 2) in any order, and their standard deviations (N,), about a cubic spline through them without gross
// errors; nothing where there are too few.
AboutCurve about_curve(ConstMatrix points, ConstVector sigma, const ScatterSettings& settings);

// Ratio of the scatter of lines about smooth curves to their standard deviations, errors that neighbours share counted
// in; NaN without lines.
double scatter_about(const std::vector<AboutCurve>& lines, const ScatterSettings& settings);

}  // namespace vbaa
