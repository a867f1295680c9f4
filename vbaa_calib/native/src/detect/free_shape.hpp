// The shapes that the antenna can take: its free shape in space, bent by a force, as a camera sees it.
#pragma once

#include "arrays.hpp"

namespace vbaa::detect {

// Unknowns of a shape: offset (m) and turn (rad) at the clamp, bend (rad) in the picture and towards the camera, and
// the logarithm of the force's place, over the antenna's length.
constexpr int SHAPE_UNKNOWNS = 5;

// The free antenna in the camera's frame.
struct FreeShape {
    ConstVector clamp_m;     // (3,)
    ConstMatrix axes;        // (3, 3) rows: along the antenna at its clamp, lateral in the picture, and the third
    ConstMatrix segments_m;  // (S, 3) equal ones from clamp to tip, along these axes
};

// The least `Corridor.misfit` of all shapes, or the first that is `enough` or less.
// seen : (N, 2) ideal normalized points, variance : (N,) of each. allowed : (3,) by how much (m, rad) the antenna may
// leave its clamp laterally and turned; standard deviation of its bend towards the camera. starts : (M,
// SHAPE_UNKNOWNS).
double misfit(const FreeShape& free, ConstMatrix seen, ConstVector variance, ConstVector allowed, double enough,
              ConstMatrix starts);

// Means (M, 2) of runs of points (N, 2), for a largest M, and their variances (M,).
struct Runs {
    Array<double, 2> means;
    Array<double, 1> variance;
};

Runs means_of_runs(ConstMatrix points, ConstVector sigma, int most);

}  // namespace vbaa::detect
