// Many contacts at once, each linearised where it is: predictions and their derivatives, without a fit.
#pragma once

#include "solver/frames.hpp"

namespace vbaa::solver {

// B contacts, see `Linearised` in Python.
struct Linearised {
    Cube tangents, columns, readings, information;
    Matrix point_force, residual, side, prior;
    Vector excess;
};

// The frames on a rung at unknowns (B, 4), the rig as calibrated.
void linearise_frames(const Rig& rig, const Frames& frames, int rung, ConstMatrix unknowns, const Linearised& found);

// Frames as the free antenna, see `FreeAntennas` in Python.
struct FreeAntennas {
    Cube information;
    Matrix side;
    Vector gain;
};

// About rig steps (B, R). An end of the antenna farther off than so many σ, the rig's included, is another thing's and
// not used.
void free_frames(const Rig& rig, const Frames& frames, ConstMatrix steps, double farthest_std,
                 const FreeAntennas& found);

}  // namespace vbaa::solver
