// How far detected points lie from a predicted curve in normalized image coordinates, along the curve's normal.
#pragma once

#include "arrays.hpp"

namespace vbaa::lens {

// A curve: nodes (M, 2), M ≥ 2, and slopes (M, 2) by arc length, at increasing arc lengths (M,), m.
struct ImageCurve {
    ConstVector arclength_m;
    ConstMatrix nodes, slopes;
};

// Points and derivatives (N, 2) at arc lengths (N,), by cubic Hermite between the nodes.
void interpolate(const ImageCurve& curve, ConstVector arclength_m, Matrix points, Matrix along);

// Arc lengths (N,) of the points of a curve nearest to points (N, 2): from the nearest node by two Newton steps, each
// of which squares an error of a few hundredths of the nodes' spacing.
void feet(const ImageCurve& curve, ConstMatrix points, Vector arclength_m);

// K curves: arc lengths (K, M), nodes and slopes (K, M, 2).
struct ImageCurves {
    ConstMatrix arclength_m;
    ConstCube nodes, slopes;

    ImageCurve operator[](int k) const { return {arclength_m.row(k), nodes.row(k), slopes.row(k)}; }
};

// Residuals (N, K) of points (N, 2) with covariance (N, 2, 2) from K curves at the feet on the first, along its normal,
// over their standard deviations; and the normals (N, 2) over those.
void whitened(ConstMatrix points, ConstCube covariance, const ImageCurves& curves, Matrix residuals, Matrix normals);

}  // namespace vbaa::lens
