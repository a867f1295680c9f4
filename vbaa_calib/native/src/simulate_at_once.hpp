// Frictionless contacts, all frames of a stroke at once; vbaa_calib/simulate/contact/at_once.py has the equations.
#pragma once

#include "arrays.hpp"
#include "shooting.hpp"

namespace vbaa::simulate {

struct Pressing {
    double reach_m;       // the object's radius plus the antenna's at its clamp
    double compliance;    // the object's, in m per EI/L²
    double force_unit_N;  // EI/L²
    double tolerance;
    double antenna_radius_m;  // at its clamp
};

// Solve frames (R, 9, 3) from states x (R, 7), which are overwritten, within limits (R, 2, 7), low and high. Gives the
// first frame that was not found, −1 where all were.
//
// A frame's vectors: gravity, core, what the depth is along the normal, the projection across the core, the normal at
// which the search starts, and the axes across it.
int touch_at_once(const antenna::Rod& rod, const Pressing& pressing, ConstCube frames, ConstCube limits, Matrix x);

}  // namespace vbaa::simulate
