// Is there a second contact? A score test: what another force elsewhere would explain.
#pragma once

#include "solver/structs.hpp"

namespace vbaa::solver {

// The best second force: how much it lowers the cost, at the scatter that neighbouring points have; where it acts, in
// antenna lengths; how far the first contact's distance would move, in σ. Zeros where the residuals have no structure.
struct SecondForce {
    double gain = 0.0, place = 0.0, shift = 0.0;
};

// Score test of a second force in a frame. problem: the fit with the residuals of the highest rung, which has the exact
// shapes, and their sums.
SecondForce second_force(const Task& task, const Fit& fit, const Fit& problem, double distance_std);

// Forces at G places. tip_m: deflection of the tip by each. force_N, lever: sizes, and moments at the clamp, N·m.
struct Pushes {
    ConstVector tip_m, force_N, lever;
};

// Effects (READINGS, 2 G) of these forces along y and z on the readings, in σ.
void push_readings(const Rig& rig, const Frame& frame, const Fit& fit, const Pushes& pushes, Matrix readings);

}  // namespace vbaa::solver
