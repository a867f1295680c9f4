// The antenna's line in a picture with colours: kept where a ribbon's two edges are more likely than one.
#pragma once

#include "detect/profile.hpp"
#include "detect/ribbon.hpp"

namespace vbaa::detect {

// How a ribbon's line is measured.
struct RibbonMeasuring {
    double width_px, blur_px;
    int half;      // profiles have 2·half + 1 pixels
    int channels;  // of the picture, that are searched
    RibbonPriors priors;
};

// The line along a path (K, 2) near the antenna; none where no profile shows it.
std::optional<MeasuredLine> measured_ribbon(const Picture& picture, ConstMatrix path_px, const RibbonMeasuring& how);

}  // namespace vbaa::detect
