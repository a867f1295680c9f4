// Derivatives of what the model predicts of a frame by the rig: antenna, camera's pose, sensor, lens.
#pragma once

#include "solver/structs.hpp"

namespace vbaa::solver {

// The fit's columns along the rig's axes, on one rung, about the fit's prediction.
// The paper's rung has neither clamp angle nor weight nor bow: it takes their effect from the linear one.
void rig_jacobian(const Rig& rig, const Frame& frame, int rung, Bent& bent, Fit& fit);

}  // namespace vbaa::solver
