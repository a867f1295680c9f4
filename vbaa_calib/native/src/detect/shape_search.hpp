// The shapes that an antenna can take along which a picture shows the most edges on both of its sides.
//
// An edge is a difference of colour across it that is large relative to what neighbouring places differ by; which side
// is the brighter one does not matter, nor whether both sides of the antenna have the same background. The log odds of
// two edges, one width apart, add up along a shape, once per correlation length; where the antenna's usual colours are
// known, so do the log odds that what lies between the edges has them.
#pragma once

#include <array>
#include <vector>

#include "detect/shape_strip.hpp"

namespace vbaa::detect {

// The family of shapes that is searched, about a free axis.
struct ShapeFamily {
    ConstMatrix axis_px;      // (S, 2) the free antenna, in equal steps
    ConstCube rough_px;       // (R, T, 2) rough paths, near which it is searched
    double spacing_px = 0.0;  // distance of neighbouring shapes' tips
    double width_px = 0.0;
    ConstVector contacts;                    // (C,) where a force may act, parts of the length
    double clamp_px = 0.0, clamp_rad = 0.0;  // by how much it may be moved and turned at the clamp
};

// The log odds of one shape, and the shape.
struct ShapeFound {
    double evidence = 0.0;
    std::array<double, 4> bend = {};  // contact, turn of the tip (rad), offset (px) and turn (rad) at the clamp
    Array<double, 2> path_px;         // (S, 2)
    Array<double, 1> odds;            // (S,) at each of its points
};

// A shape near each rough path, without those that resemble a better one; the best one first. looks : (8, 4) mean
// colours (b, g, r) from clamp to tip and their deviations, or (0, 4); of a grey picture, their luma counts.
std::vector<ShapeFound> likely_shapes(const Picture& picture, const ShapeFamily& family, ConstMatrix looks,
                                      const EdgeModel& model);

}  // namespace vbaa::detect
