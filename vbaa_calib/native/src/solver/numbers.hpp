// The fits of frames in plain numbers: contact points, forces and their covariances.
#pragma once

#include <cstdint>

#include "solver/marginal.hpp"
#include "solver/second_contact.hpp"
#include "solver/structs.hpp"
#include "solver/uncertainty.hpp"

namespace vbaa::solver {

// Pieces of the antenna; their places are input for the test of motion.
constexpr int PIECES = 12;
// A rung's predicted bias is small below this fraction of the standard deviation; a demanded rung's larger one is added
// to the standard deviations.
constexpr double SMALL_BIAS = 1.0 / 3.0;

// Arrays of one row for each frame, see `FitNumbers` in Python.
struct Numbers {
    View<std::int64_t, 1> points, evaluations, rung, rig_axes, farthest_camera, outliers;
    View<bool, 1> converged, at_tip, finite, ambiguous, marginal;
    View<bool, 2> sensor_available;
    Vector shared_std, friction_share, tip_std, cost, rig_chi_square, evidence, scatter, condition, alternative_cost,
        second_gain, second_place, second_shift, edge_on_rad, drift_px, drift_readings, left_px, farthest;
    Matrix unknowns, std, point_m, force_N, tangent, deflection_m, residual, residual_std, alternative_unknowns, bias,
        pieces_std_m;
    Cube covariance, with_pose, shared, pieces_m, push;
};

// What was found of a frame next to its best fit and uncertainty.
struct Findings {
    int rung;                    // that the fit is on
    int needed;                  // the lowest that is good enough, or the one that was demanded
    double bias[REFERENCE + 1];  // of the rungs, NaN where not compared
    Errors errors = {};          // what rungs leave out
    Alternative other;           // the next best minimum; its cost beyond the best one's
    double evidence;             // for a contact
    SecondForce second;
    bool ambiguous = false;  // its mirror image looks like it
    Marginal marginal;       // over its force along the line of sight, if no reading shows that
    double left_px;          // how far most points stay from the nearest antenna, if the fit ended for that; else NaN
};

// Writes a frame's fit into a row. pieces_m: (PIECES,) arc lengths, or none.
void write_numbers(const Rig& rig, const Frame& frame, const Uncertainty& found, const Findings& findings,
                   ConstVector pieces_m, const Numbers& numbers, int row, Work& work);

// Angle between the deformation plane and the ray from the camera's centre to the contact, rad.
// At 0 the camera's centre lies in that plane and the antenna looks straight however it bends.
double angle_edge_on(const Rig& rig, const Camera& camera, const double* unknowns);

}  // namespace vbaa::solver
