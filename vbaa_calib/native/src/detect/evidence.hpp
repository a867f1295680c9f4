// Evidence of a ribbon in a picture: something of one colour between two surfaces of other colours.
#pragma once

#include "arrays.hpp"

namespace vbaa::detect {

// Rows of a step down the picture: not even, so that one is the middle.
constexpr int ROW_STEP = 5;
// Directions, by so many radians apart, from 45° to one side of straight down to 45° to the other.
constexpr int DIRECTIONS_DOWN = 17;
constexpr double DIRECTION_STEP = 0.09817477042468103;  // π/32

// By how much a direction is off straight down, in radians.
constexpr double slant_of(int direction) { return (direction - 0.5 * (DIRECTIONS_DOWN - 1)) * DIRECTION_STEP; }

// Assumptions about a ribbon and its background; grey levels.
struct RibbonModel {
    double width_px = 0.0;
    ConstVector noise;    // (channels,) standard deviation of a pixel
    ConstVector shading;  // (channels,) by which neighbouring places of one surface differ
    ConstVector spread;   // (channels,) by which those of different surfaces differ
    double flat = 0.0;    // share of places of the background that have one colour on both sides
    double edge = 0.0;    // share of those with an edge on one of the sides
    double chance = 0.0;  // share of those with three colours
    double gap = 0.0;     // least log odds: the ribbon may be hidden
};

// Log odds (steps, directions, columns), per width of length, that a ribbon in planes (channels, H, W) runs in a
// direction through a column of a step's middle row. Places outside the picture are excluded; those with a flank
// outside have log odds of 0 at most.
Array<float, 3> ribbon_evidence(View<const float, 3> planes, const RibbonModel& model);

}  // namespace vbaa::detect
