// Log odds of an antenna at offsets from a path, in a strip of a picture along it.
#pragma once

#include "detect/edge_model.hpp"

namespace vbaa::detect {

constexpr double STRIP_STEP_PX = 0.5;  // across

// Log odds (S, M) of an antenna with its middle at an offset from a path (S, 2) along its normals.
struct Strip {
    Table path, normal;
    Array<float, 2> odds;
    double first = 0.0;  // offset (px) of the first ones; STRIP_STEP_PX to the next
};

// What a strip is made with.
struct StripModel {
    double width_px;
    const Looks* looks;  // or none
    Colour noise;        // deviation of a pixel in each channel
    const EdgeModel& edges;
    const EdgeOdds& odds;
};

// Of what lies up to `reach_px` from a path.
template <class T>
Strip strip_along(const Colours<T>& picture, ConstMatrix path, double reach_px, const StripModel& model);

}  // namespace vbaa::detect
