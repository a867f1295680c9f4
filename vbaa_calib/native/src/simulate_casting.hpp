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

// Direction towards the lamp, and what part of the light comes from everywhere.
struct Light {
    Point lamp;
    double ambient;
};

// What rays see of a white object.
struct Lit {
    Array<double, 1> brightness;  // (N,) of the light, stains included; zero for a miss
    Array<std::int8_t, 1> faces;  // (N,) as of `Hits`
};
// rays: (N, 2) x/z and y/z in the camera's frame, which `turn` rotates into the world's.
Lit lit(const Body& body, const Point& origin_m, const Rotation& turn, ConstMatrix rays, const Light& light);

}  // namespace vbaa::simulate
