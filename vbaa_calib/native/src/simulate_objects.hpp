// How far points are from an object that the antenna touches; vbaa_calib/simulate/scene/objects.py describes them.
#pragma once

#include "arrays.hpp"
#include "vectors.hpp"

namespace vbaa::simulate {

// In the order of SHAPES in objects.py.
enum Kind { CYLINDER, SPHERE, KNIFE, BOX, FREEFORM };

struct Object {
    int kind;
    Point center_m, axis, wedge;
    Point into_faces[2];  // unit vectors into a box, each across one of its two faces
    double radius_m;
    ConstMatrix bumps;  // (K, 5) directions, heights and widths
};

// Distance from the surface, negative inside, and its outward normal at the nearest point.
struct Surface {
    double distance_m;
    Point normal;
};
// Where no nearest point is found, deep inside a free form: F over its slope, and the slope's direction; NaN in the
// centre. On the core of the others the normal is NaN.
Surface signed_distance(const Object& object, const Point& point_m);

// Distances (K,) and normals (K, 3) of points (K, 3).
struct Surfaces {
    Array<double, 1> distances_m;
    Array<double, 2> normals;
};
Surfaces signed_distances(const Object& object, ConstMatrix points_m);

// Quantities (K,) that grow with the distance and have its sign, computed without a search.
Array<double, 1> rough_distances(const Object& object, ConstMatrix points_m);

// F of a free form at a point from its centre, and its gradient.
struct Elevation {
    double value;
    Point slope;
};
Elevation elevation(const Point& point_m, double radius_m, ConstMatrix bumps);
// The same of points (K, 3), as distances and normals.
Surfaces elevations(ConstMatrix points_m, double radius_m, ConstMatrix bumps);

// Distances (K,) of a free form's surface from its centre along unit vectors (K, 3).
Array<double, 1> surface_radii(ConstMatrix directions, double radius_m, ConstMatrix bumps);

// The first of A poses (A, 3, 3), (A, 3) at which one of the points (N, 3) is nearer than its room (N,); A where none
// is.
int first_within(const Object& object, ConstCube rotations, ConstMatrix origins_m, ConstMatrix points_m,
                 ConstVector room_m);

}  // namespace vbaa::simulate
