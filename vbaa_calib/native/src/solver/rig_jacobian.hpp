// Derivatives of what the model predicts of a frame by the rig: antenna, camera's pose, sensor, lens.
#pragma once

#include "solver/structs.hpp"

namespace vbaa::solver {

// Derivatives by the rig's Q parameters, of the fit's samples along their normals, the readings (in σ, all available)
// and contact point and force, into `bent.raw`, `raw_readings` and `raw_point_force`.
// The paper's rung has neither clamp angle nor weight nor bow: it takes their effect from the linear one.
void rig_derivatives(const Rig& rig, const Frame& frame, int rung, Bent& bent, const Fit& fit);

// Rows (M, K) from those of the samples, which stand in their places, in some vectors of columns, but for
// `kept` ones of the first.
void fill_between_samples(const std::vector<int>& vectors, int kept, Matrix rows);

// The fit's columns along the rig's axes, on one rung, about the fit's prediction.
void rig_jacobian(const Rig& rig, const Frame& frame, int rung, Bent& bent, Fit& fit);

}  // namespace vbaa::solver
