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
// Settings of a frame's points.
struct PointSettings {
    int fewest = 5;            // that are fitted
    double stretch_std = 4.0;  // residual, in σ, from which a stretch may lie off
    int side = 8;              // on each side of a jump, at most: their medians determine it
};

// The numbers of a frame's fit, see `FitNumbers` in Python, which holds an array of these.
struct Numbers {
    std::int64_t points, evaluations, rung, rig_axes, farthest_camera, outliers;
    double unknowns[UNKNOWNS], std[UNKNOWNS], alternative_unknowns[UNKNOWNS], bias[REFERENCE + 1];
    double point_m[3], force_N[3], tangent[3], deflection_m[3];
    double covariance[6][6], with_pose[6][6], shared[6][6], residual[READINGS - 1], residual_std[READINGS - 1];
    double shared_std, friction_share, tip_std, cost, rig_chi_square, evidence, scatter, condition, alternative_cost;
    double second_gain, second_place, second_shift, edge_on_rad, drift_px, drift_readings, left_px, farthest, jump;
    double pieces_m[PIECES][3], pieces_std_m[PIECES], push[PIECES][2];
    bool sensor_available[READINGS - 1], converged, at_tip, finite, ambiguous, marginal, explained_alone,
        explained_drifted;
};

// Findings on a frame in addition to its best fit and uncertainty.
struct Findings {
    int rung;                    // that the fit is on
    int needed;                  // the lowest that is good enough, or the one that was demanded
    double bias[REFERENCE + 1];  // of the rungs, NaN where not compared
    Errors errors = {};          // errors of the rungs
    Alternative other;           // the next best minimum; its cost beyond the best one's
    double evidence;             // for a contact
    SecondForce second;
    bool ambiguous = false;  // its mirror image looks like it
    Marginal marginal;       // over its force along the line of sight, if no reading shows that
    double left_px;          // how far most points stay from the nearest antenna, if the fit ended for that; else NaN
};

// Writes a frame's fit. pieces_m: (PIECES,) arc lengths, or none.
void write_numbers(const Task& task, const Uncertainty& found, const Findings& findings, ConstVector pieces_m,
                   Numbers& numbers);

// Angle between the deformation plane and the ray from the camera's centre to the contact, rad.
// At 0 the camera's centre lies in that plane and the antenna looks straight however it bends.
double angle_edge_on(const Rig& rig, const Camera& camera, const double* unknowns);

}  // namespace vbaa::solver
