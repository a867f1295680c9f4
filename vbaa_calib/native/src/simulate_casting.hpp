// Where rays meet an object that is drawn; vbaa_calib/simulate/render/object.py says which planes it has.
#pragma once

#include <cstdint>

#include "simulate_objects.hpp"

namespace vbaa::simulate {

// The drawn shape of an object.
struct Body {
    Object object;
    ConstMatrix sides;  // (K, 4) half-spaces normal·(x − centre) ≤ offset
    Rotation across;    // projects on the directions across its axis
    double reach_m;     // radius about the centre that holds it
    double steepest;    // bound on the slope of F along any line, for a free form
};

// First hits of rays from one origin along directions (N, 3), world frame.
struct Hits {
    Array<double, 1> depths;       // in lengths of the ray's vector, infinite for a miss
    Array<double, 2> normals;      // (N, 3), zero for a miss
    Array<std::int64_t, 1> faces;  // a round side is face 0, a miss −1
};
Hits cast_rays(const Body& body, const Point& origin_m, ConstMatrix directions);

// Reflected light (N,) at each hit, stains included, from the arriving `lights` (N,); zero for a miss.
Array<double, 1> shade(const Point& center_m, const Point& origin_m, ConstMatrix directions, ConstVector depths,
                       ConstVector lights);

}  // namespace vbaa::simulate
