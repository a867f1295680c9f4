// Contacts of frames without a reading, over all forces along the line of sight: only perspective shows these.
#pragma once

#include "solver/alternative_minima.hpp"
#include "solver/structs.hpp"

namespace vbaa::solver {

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
void marginalise(const Rig& rig, const Frame& frame, int rung, Fit& best, const Alternative& other, Uncertainty& found,
                 Marginal& marginal, Work& work);

}  // namespace vbaa::solver
