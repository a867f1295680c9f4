// Levenberg–Marquardt for one frame, and the steps around it that make a fit converge.
#pragma once

#include "solver/structs.hpp"

namespace vbaa::solver {

// Least contact distance that is searched, in antenna lengths.
constexpr double NEAREST = 0.03;
// N points with a median residual that exceeds its expectation by this over √N scatter more than noise: three
// deviations.
constexpr double EXCESS_SCATTER = 3.5;
// Largest friction angle that is searched, in standard deviations of its prior.
constexpr double LARGEST_FRICTION = 4.0;
// Iterations of a rough descent.
constexpr int COARSE_ITERATIONS = 5;
// Median residual, in standard deviations, beyond which the shape is not that of one contact.
constexpr double WRONG_SHAPE = 3.0;
// Largest scatter: with more, a fit would end at its priors.
constexpr double MOST_SCATTER = 5.0;

// The minimum reached from the fit's unknowns, with feet near the right ones, if known, and the rig as in a rough fit
// there, if there is one, else as calibrated.
//
// Deviations that neither noise nor rig explains (a second contact, a kink) must not be fitted as if they were exact,
// nor make most points outliers: such a frame is fitted again with the scatter of its points.
void converge(const Task& task, const Fit* rough, Fit& fit, bool with_feet);

// The minimum at the fit's distance, with feet near the right ones; whether that explains the frame. A force that
// hardly anything asks for leaves its distance open: a descent would wander along the antenna.
bool converge_there(const Rig& rig, const Frame& frame, int rung, Fit& fit, Work& work);

// Grants evaluations of the model for a search; a fit that explains most points grants all.
void begin_search(Work& work);

// A rough minimum reached from the fit's unknowns and the rig as calibrated, the points scattering so many times more
// than their noise.
void coarse_minimum(const Task& task, Fit& fit, bool with_feet, double scatter, int iterations);

// Unknowns after a step (4,) that is linear in the clamp's moment, because the cost's valley is curved in the force.
Unknowns moved_unknowns(const Rig& rig, const Unknowns& unknowns, const double* step);

}  // namespace vbaa::solver
