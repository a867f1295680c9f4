// What is known of an antenna before it is looked for.
#pragma once

#include "arrays.hpp"

namespace vbaa::detect {

// Of an antenna that is looked for along a path (path_refinement.Known).
struct Known {
    double clamp_px;     // how far off the path it may begin
    ConstMatrix levels;  // (L, 2) usual grey level at places from clamp to tip and its deviation; (0, 2) if not known
    bool leaves_along;   // whether it leaves its clamp along the path: on a calibrated rig
    bool stands_out;     // it is bright on this plane, which was made for it, where what lies behind it is not known
};

struct Level {
    double usual, spread;  // grey levels: mean and standard deviation
};

// The usual level at a share of the way from clamp to tip, of levels (L, 2), L ≥ 2.
Level usual_level(ConstMatrix levels, double share);

}  // namespace vbaa::detect
