// Evidence of a ribbon in a picture: something of one colour between two surfaces of other colours.
#pragma once

#include "arrays.hpp"

namespace vbaa::detect {

// Main direction of a search: down the picture, from row to row, `ROW_STEP` apart.
constexpr int ROW_STEP = 6;
// Directions, by so many radians apart, the middle one straight down.
constexpr int DIRECTIONS_DOWN = 25;
constexpr double DIRECTION_STEP = 0.09817477042468103;  // π/32

// Columns by which a path that ends at a row goes on, from the row before, in one of the directions.
double columns_of(int direction);

// What a ribbon and its background are supposed to be like; grey levels.
struct RibbonModel {
    double width_px = 0.0;
    ConstVector noise;    // (channels,) standard deviation of a pixel
    ConstVector shading;  // (channels,) by which neighbouring places of one surface differ
    double spread = 0.0;  // by which colours of different surfaces differ
    double flat = 0.0;    // share of places of the background that have one colour on both sides
    double edge = 0.0;    // share of those with an edge on one of the sides
    double chance = 0.0;  // share of those with three colours
    double gap = 0.0;     // least log odds: the ribbon may be hidden
};

// Log odds (rows, directions, columns) for each width of length that a ribbon in planes (channels, H, W) ends its step
// at a row and column in a direction. Places that `within` (H, W), 0 to 1, leaves out are no ribbon's; those of which
// the flanks it leaves out have log odds 0.
Array<float, 3> ribbon_evidence(View<const float, 3> planes, View<const float, 2> within, const RibbonModel& model);

}  // namespace vbaa::detect
