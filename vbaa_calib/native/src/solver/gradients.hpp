// Derivatives of contacts by the measurements and the rig: the implicit function theorem at the minimum of each fit.
#pragma once

#include "solver/frames.hpp"

namespace vbaa::solver {

// Results: the contact's distance, m, its point (3), m, and force (3), N, antenna frame.
constexpr int RESULTS = 7;

// Derivatives of the results of B frames: (B, 7, N, 2) by the ideal points, 0 for those that do not count;
// (B, 7, readings) by what is read, 0 for the end; (B, 7, 3) by gravity in the antenna frame; (B, 7, Q) by the rig's
// parameters.
struct Gradients {
    View<double, 4> by_points;
    Cube by_readings, by_gravity, by_rig;
};

// Where frames converged on a rung: unknowns (B, 4), their points scattering (B,) times more than their σ.
struct Minima {
    int rung;
    ConstMatrix unknowns;
    ConstVector scatter;
    View<const bool, 1> at_tip;
};

//
// Residuals beyond HUBER pull alike wherever they lie, so nothing follows them. Second derivatives of the prediction
// are left out as in Gauss–Newton: they are weighted by the residuals, with a mean near zero.
void gradients(const Rig& rig, const Frames& frames, const Minima& minima, const Gradients& found);

}  // namespace vbaa::solver
