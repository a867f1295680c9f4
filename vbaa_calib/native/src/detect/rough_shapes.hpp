// Which of many tabled paths show the most edges on both of their sides, in a reduced picture.
#pragma once

#include "detect/edge_model.hpp"

namespace vbaa::detect {

// Which paths are tried.
struct RoughPaths {
    ConstCube paths_px;  // (P, T, 2)
    double spacing_px;   // by which the tips of neighbouring ones are apart
    double width_px;     // of the antenna
};

// (P,) mean log odds of the paths. noise : deviation of a pixel of the picture, in each channel.
template <class T>
Numbers rough_scores(const Colours<T>& picture, const RoughPaths& paths, const Looks* looks, const Colour& noise,
                     const EdgeModel& model);

}  // namespace vbaa::detect
