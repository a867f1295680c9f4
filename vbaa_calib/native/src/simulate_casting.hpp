// Where rays meet an object that is drawn; vbaa_calib/simulate/render/object.py says which planes it has.
#pragma once

#include <cstdint>

#include "simulate_objects.hpp"
#include "simulate_picture.hpp"

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

// (2, rows, columns) brightness of a white object, stains included and weighted with the part of the pixel that it
// covers, and that part. The rays are those of a map as `rays_between` has it, which `turn` rotates into the world's
// axes: one in a pixel's middle, `factor` squared where its neighbours see something else.
Array<float, 3> object_pixels(const Body& body, const Point& origin_m, const Rotation& turn, ConstRays padded,
                              const Window& window, const Light& light);

}  // namespace vbaa::simulate
