// Polylines in a plane: arc lengths, even spacing, normals, and how points lie relative to them; in any unit.
#pragma once

#include <cstdint>

#include "arrays.hpp"

namespace vbaa {

// (K,) distance of the points of a polyline (K, 2) along it, from its start.
Array<double, 1> arc_lengths(ConstMatrix polyline);

// Points (K, 2) at equal spacing along a polyline, and the arc length (K,) of each.
struct Resampled {
    Array<double, 2> points;
    Array<double, 1> along;
};

// Resamples a polyline at equal spacing, short of its end; no points where its length is not finite.
Resampled resample(ConstMatrix polyline, double spacing);

// (K, 2) unit normals (-v, u) of a polyline, with directions smoothed over neighbours; zeros where K < 2.
Array<double, 2> normals(ConstMatrix polyline);

// Index (N,) of the nearest point of a polyline, and the distance (N,) from it along the normal there.
struct Nearest {
    Array<std::int64_t, 1> index;
    Array<double, 1> distance;
};

// The nearest points of a finely spaced polyline (K, 2), K ≥ 2, to points (N, 2).
Nearest nearest_on(ConstMatrix polyline, ConstMatrix points);

// Where points (N, 2) lie about a curve: node coordinate (N,) of the nearest place, distance (N,) along the unit normal
// (N, 2) there. The curve is cubic between nodes (M, 2) with slopes (M, 2) by arc length (M,), M ≥ 2.
struct Feet {
    Array<double, 1> place, distance;
    Array<double, 2> normal;
};
Feet feet_on(ConstMatrix nodes, ConstMatrix slopes, ConstVector arclength, ConstMatrix points);

}  // namespace vbaa
