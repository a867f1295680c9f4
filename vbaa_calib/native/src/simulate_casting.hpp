// Where rays meet an object that is drawn; vbaa_calib/simulate/render/object.py says which planes it has.
#pragma once

#include <cstdint>

#include "simulate_objects.hpp"

namespace vbaa::simulate {

// What is drawn of an object.
struct Body {
    Object object;
    ConstMatrix sides;  // (K, 4) half-spaces normal·(x − centre) ≤ offset
    Rotation across;    // projects on the directions across its axis
    double reach_m;     // radius about the centre that holds it
    double steepest;    // how fast F grows at most along a way in a free form
};

// First hits of rays from one origin along directions (N, 3), world frame.
struct Hits {
    Array<double, 1> depths;       // in lengths of the ray's vector, infinite for a miss
    Array<double, 2> normals;      // (N, 3), zero for a miss
    Array<std::int64_t, 1> faces;  // a round side is face 0, a miss −1
};
Hits cast_rays(const Body& body, const Point& origin_m, ConstMatrix directions);

// How much of the light on a hit comes back, stains included: `lights` (N,) of it arrive; zero for a miss.
Array<double, 1> shade(const Point& center_m, const Point& origin_m, ConstMatrix directions, ConstVector depths,
                       ConstVector lights);

}  // namespace vbaa::simulate
