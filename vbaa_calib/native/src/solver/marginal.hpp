// Contacts of frames without a reading, over all forces along the line of sight: only perspective shows these.
#pragma once

#include "solver/alternative_minima.hpp"
#include "solver/structs.hpp"

namespace vbaa::solver {

struct MarginalSettings {
    double worthless = 1e-3;              // share of its full weight below which a reading counts as absent
    double largest_load = 3.0;            // F·l²/EI along the line of sight: a slope of some 60°
    double first_step_std = 0.7;          // first step of the force, in its σ
    double first_step_deflection = 0.02;  // the same in antenna lengths of the tip's deflection; the shorter one counts
    double coarse = 2.5;                  // change of the log density from which on a step is halved
    double fine = 0.2;                    // the same below which the next step is longer
    double longer = 1.5;                  // by this factor
    double nothing = 10.0;                // log density below the highest at which the search ends
    int most_slices = 32, most_rounds = 4, most_halvings = 6;  // on each side; to reach a slice; of a step
    double cost_change = 0.02;                                 // of the last step to a slice, at most
    double off_place = 0.02;    // part of the step by which a slice's force is off, at most
    double fixed_weight = 1e4;  // that fixes the force, over the information on forces
    double tail = 1e-4;         // weight of each tail that is left out when the farthest values are searched
    double tail_std = 4.0;      // largest distance of those from the mean, in σ
    double far = 0.005;         // change of the tip's deflection, in antenna lengths, that renews the rig's slopes
};

// Over the forces along the line of sight.
struct Marginal {
    bool known = false;
    Unknowns mean = {};
    double fixed[UNKNOWNS][UNKNOWNS] = {};              // covariance of the unknowns if that force were known
    double touch[6] = {}, touch_covariance[6][6] = {};  // contact point, m, and force, N, antenna frame
};

// Integrates a frame's posterior numerically over the force along the line of sight, all else by Laplace's method.
//
// A small deflection along the line of sight moves the picture by second order only: its posterior is flat, or has two
// maxima, mirror images, and the distance changes along with it. The prior is what is known of pushes: all directions
// across the antenna alike, and all sizes. `found` comes out with the covariance of the unknowns over all of these
// forces.
void marginalise(const Task& task, Fit& best, const Alternative& other, Uncertainty& found, Marginal& marginal);

}  // namespace vbaa::solver
