// The ladder's shapes, eight at a time: clamp, bow, weight and one point force to a curve in space.
//
// The force's bending is the planar elastica, exact in the deformation plane; weight, natural bow and what couples them
// to the force are a small rotation field on top of it, refined by sweeps of the equilibrium of moments
// (equilibrium.hpp, docs/theory_estimator.md). Rows of eight numbers, (..., LANES), belong to eight shapes, which know
// nothing of each other: what is not a number in one leaves the others alone.
#pragma once

#include "arrays.hpp"
#include "lanes.hpp"

namespace vbaa::antenna {

// Antenna models, lowest first, see vbaa_calib/antenna/rungs.py.
enum Rung { PAPER, LINEAR, ELASTICA, ROD };

// Nodes at which a shape is written: from the clamp to the contact, both included, and beyond it to the tip.
constexpr int NODES_TO_CONTACT = 40, NODES_BEYOND = 17, CURVE_NODES = NODES_TO_CONTACT + NODES_BEYOND;
constexpr int CONTACT = NODES_TO_CONTACT - 1;
// Rows of eight for all nodes of one shape.
constexpr int NODE_ROWS = whole_lanes(CURVE_NODES) / LANES;
// Contacts are kept this part of the length from the tip: there nothing would be left beyond them.
constexpr double NEAREST_TO_TIP = 1e-6;

// LANES shapes as a rung of the ladder sees them, all under one gravity; writes the last four.
//
// parameters: see vbaa_calib/antenna/shape.py. push_N: components (y, z) in the clamp's frame of the contact force
// along the antenna's normal, before it is turned with the antenna. friction_rad: its angle from that normal.
// tangents: (3, CURVE_NODES, LANES), or (3, NODE_ROWS, LANES) for those of the first shape alone, node after node, or
// (3, 0, LANES) for none. force_N: the contact's force, antenna frame; moment_Nm: x·f_z - z·f_x of all loads.
void bend_lanes(int rung, ConstMatrix parameters /*(9, LANES)*/, double length_m, const double* gravity_m_s2 /*(3,)*/,
                ConstVector contact_m, ConstMatrix push_N /*(2, LANES)*/, ConstVector friction_rad,
                Cube points_m /*(3, CURVE_NODES, LANES)*/, Cube tangents, Matrix force_N /*(3, LANES)*/,
                Vector moment_Nm /*(LANES,)*/);

}  // namespace vbaa::antenna
