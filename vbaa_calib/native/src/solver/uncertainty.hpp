// Covariance, contact evidence and model bias of a converged fit.
#pragma once

#include "solver/structs.hpp"

namespace vbaa::solver {

// First-order errors of unknowns (4), contact point and force (6) by effects that rungs leave out. A row for each rung,
// of a fit on it, if the antenna were the highest rung's; the last row, by one σ of the friction that some rungs do not
// model.
constexpr int BY_FRICTION = REFERENCE + 1;
using Errors = double[BY_FRICTION + 1][UNKNOWNS + 6];

// Inverts the fit's information by the Schur complement of the rig's part; its prior keeps that regular.
// A distance fixed at the tip gets the σ that it would have if it were free.
void uncertainty(const Fit& fit, Uncertainty& found, Work& work);

// Σψ²/Σw of Huber's ψ and weights: about 1 where points scatter as their σ say.
double huber_excess(const Fit& fit);

// `huber_excess` where it is larger than noise explains, else 1.
double huber_variance_inflation(const Fit& fit);

// Covariance of contact point and force.
void touch_covariance(const Uncertainty& found, double (&total)[6][6]);

// Widens the covariance where the cost rises more slowly than its curvature says.
//
// By vision alone, the picture holds a small deflection along the line of sight by second order only: some σ out along
// the longest axis the cost is then far from what it should have risen by.
void widen_by_profile(const Rig& rig, const Frame& frame, int rung, const Fit& fit, Uncertainty& found, Work& work);

// First-order errors: of a fit on the highest rung those of all rungs, else its own and friction's. Contact point and
// force are moved with the unknowns. reference: the highest rung's prediction at the fit's unknowns.
void first_order_errors(const Task& task, const Fit& fit, const Fit& reference, Errors& errors);

// Each rung's bias from `first_order_errors`: the largest of distance, f_y and f_z, in σ. On rungs without friction,
// also by one σ of friction. Infinite where the σ are not known.
void predicted_bias(const Errors& errors, const Uncertainty& found, double (&bias)[REFERENCE + 1]);

// How much better a contact explains the frame than the free antenna: half the difference of squares.
//
// Both may move the rig within its joint covariance first, so that a clamp angle that is known badly is not taken for
// a contact. Without contact it is 1.5 to 2 (three unknowns fitted to noise). Both are compared on the highest rung,
// `problem` with its residuals: what a lower one leaves out of the weight must not pass for a force. A contact
// beyond doubt has an evidence to a third. Spoils the free antenna's residuals, and those of a few points on the rough
// rig.
double contact_evidence(const Task& task, const Task& few, const Fit& fit, const Fit& problem);

}  // namespace vbaa::solver
