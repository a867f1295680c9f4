// What the model predicts of a frame at some unknowns, and its derivatives by them.
// Everything lives on the nodes of the predicted curve. Between nodes the picture's displacement along the normal is
// taken as linear, which costs a ten-thousandth of it; the curve itself is a cubic.
#pragma once

#include "solver/structs.hpp"

namespace vbaa::solver {

// Nodes nearer to the camera's plane than this, or behind it, are taken to lie there: their picture is far off.
constexpr double NEAREST_DEPTH_M = 1e-4;

// Sets antenna, contact and force, the same in all lanes.
void lay(const Rig& rig, Bent& bent, const Unknowns& unknowns);

// Computes all lanes' shapes and pictures, and the tangents of the first lane's shape.
void bend_and_see(const Rig& rig, const Frame& frame, int rung, Bent& bent, bool with_tangents);

// Factors from a step in the picture, and from a length, to the place of the antenna's end along itself, in its σ.
struct TipAxis {
    double u, v, per_m;
};
TipAxis tip_axis(const Frame& frame, double slope_u, double slope_v);
TipAxis fitted_tip_axis(const Rig& rig, const Frame& frame, const Fit& fit);

// (2, M) displacement along the pictures' normals per metre that a node moves along y and z, antenna frame.
Array<double, 2> point_jacobian(const Rig& rig, const Fit& fit);

// Force and moment of contact and weight on a lane's shape about the antenna frame's origin, and 1; of a rig that reads
// the moment about y alone only that.
struct ClampWrench {
    double values[WRENCH];
};
ClampWrench clamp_wrench(const Rig& rig, const Frame& frame, const Bent& bent, int lane);

// A reading as the product of a wrench with its row of coefficients.
double read_by(const double (&row)[WRENCH], const ClampWrench& wrench);

// Readings by a force of 1 N along y (0) or z (1) at a distance from the clamp, in their σ.
double by_force(const Rig& rig, int reading, int axis, double distance_m);

// The prediction of the free antenna.
void predict_free(const Rig& rig, const Frame& frame, Bent& bent, Fit& fit);

// The prediction at the fit's unknowns; without `derivatives` its columns by the unknowns stay as they are.
void predict(const Rig& rig, const Frame& frame, int rung, Bent& bent, Fit& fit, bool derivatives);

}  // namespace vbaa::solver
