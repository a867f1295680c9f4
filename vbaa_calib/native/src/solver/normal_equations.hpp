// Points and readings against a prediction: residuals, robust weights, normal equations and cost of one frame.
#pragma once

#include "solver/structs.hpp"

namespace vbaa::solver {

// Weight of a whitened residual's square (IRLS).
inline double huber_weight(double residual) {
    const double size = residual < 0.0 ? -residual : residual;
    return HUBER / (size > HUBER ? size : HUBER);
}

// Prior weight of an unknown's or rig step's square.
double prior_of(const Rig& rig, const Fit& fit, int column);

// Feet of the points, searched over the whole curve.
void nearest_feet(const Rig& rig, const Frame& frame, Fit& fit);

// Feet on a nearly straight curve, the free antenna's, from places along its chord, in perspective.
void feet_along_chord(const Rig& rig, const Frame& frame, Fit& fit);

// Residuals of the points from approximate feet, which are improved.
void point_residuals(const Rig& rig, const Frame& frame, Fit& fit);

// Displacement (M,) by `count` steps of the columns from `first` on.
void shift_by_steps(const Fit& fit, int first, const double* steps, int count, Vector shift);

// Take the rig's steps out of the residuals. `shift` is scratch room.
void residuals_with_rig(Fit& fit, Vector shift);

// Residuals, contact point and force after a small step (K,), by the fit's columns.
void step_linearly(Fit& fit, const double* step, Vector shift);

// Robust cost of the points; renews their weighted sums over the nodes.
double points_cost(Fit& fit);

// The points' tridiagonal information times columns (M, C), C a multiple of LANES.
void times_tridiagonal(const Fit& fit, ConstMatrix columns, Matrix product);

// The information that the points' weighted sums give on the fit's columns, its upper triangle. product : (M, K′) these
// sums times the columns, zero where a picture does not depend on them.
void information_of_points(const Rig& rig, Fit& fit, Matrix product);

// Information, right side and cost of the columns from `first` on (4: the rig alone), at the residuals as they are.
// product : (M, K′) scratch room.
void normal_equations(const Rig& rig, Fit& fit, int first, Matrix product);

// Residuals about the fit's prediction, the rig's steps taken out. Feet come out nearer to the right ones.
void linearise(const Rig& rig, const Frame& frame, Fit& fit, Work& work);

// A fit as it is at its state, without a step: prediction, residuals and normal equations.
void evaluate(const Rig& rig, const Frame& frame, int rung, Fit& fit, Work& work);

// Robust cost with the priors, at the residuals as they are; nothing of the fit changes.
double total_cost(const Rig& rig, const Fit& fit);

// Least cost of the linear problem about a fit by IRLS, in so many rounds at most. Spoils the fit's state. first : 0,
// or 4 where only the rig may move. The step is taken from where the fit is, priors included. A cost above `enough`
// need only be accurate to a fifth.
double least_cost(const Rig& rig, Fit& fit, int first, int rounds, Work& work, double enough = INFINITE);

// Puts a rough fit's rig steps among zeros, the steps of all axes: the rough rig has the first of these.
void put_rough_steps(const Rig& rig, const Fit& rough, double* steps);

// The cost with the σ that the points came with: only these compare between fits.
double unscaled_cost(const Rig& rig, Fit& fit);

}  // namespace vbaa::solver
