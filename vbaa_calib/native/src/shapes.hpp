// The ladder's shapes, eight at a time: clamp, bow, weight and one point force to a curve in space.
//
// The force's bending is the planar elastica, exact in the deformation plane 𝒟; weight, natural bow and what couples
// them to the force are a small rotation field on top of it, refined by sweeps of the equilibrium of moments
// (equilibrium.hpp, docs/theory_estimator.md). Rows of eight numbers, (..., LANES), belong to eight shapes, which are
// independent: NaN in one does not affect the others.
#pragma once

#include "arrays.hpp"
#include "lanes.hpp"
#include "nodes.hpp"
#include "taper.hpp"

namespace vbaa::antenna {

// Antenna models, lowest first, see vbaa_calib/antenna/rungs.py.
enum Rung { PAPER, LINEAR, ELASTICA, ROD };

// Passes over the equilibrium of moments that a rung takes.
//
// Largest distance from vbaa_calib.antenna.rod in 60 antennas bowed by 0.2 /m, clamped 1° askew, gravity in all
// directions, friction of ±0.3 rad, with the contact's slope at 20°, 35° and 45°, in µm: one sweep 87, 298, 570; two
// 3.4, 17, 41; three 0.14, 1.0, 2.8; four 0.006, 0.06, 0.21.
constexpr int sweeps_of(int rung) { return rung == ELASTICA ? 1 : 4; }

// B antennas and what bends them, see vbaa_calib/antenna/shape.py. push_N: components (y, z) in the clamp's frame of
// the contact force along the antenna's normal, before it is turned with the antenna; a dead force keeps its direction.
// friction_rad: its angle from that normal.
struct Presses {
    ConstMatrix parameters;  // (B, 9)
    double length_m;
    const Taper& taper;
    ConstMatrix gravity_m_s2;  // (B, 3)
    ConstVector contact_m;
    ConstMatrix push_N;  // (B, 2)
    ConstVector friction_rad;
    bool dead;
};

// LANES shapes: points (3, CURVE_NODES, LANES); tangents as many, or (3, NODE_ROWS, LANES) for those of the first shape
// alone, node after node, or (3, 0, LANES) for none; the contact's force (3, LANES), antenna frame; x·f_z − z·f_x of
// all loads, (LANES,).
struct Made {
    Cube points_m, tangents;
    Matrix force_N;
    Vector moment_Nm;
};

// LANES shapes as a rung of the ladder sees them; all arrays of `presses` are transposed, and its gravity is one,
// (3, 1), or each shape's, (3, LANES).
void bend_lanes(int rung, const Presses& presses, const Made& made);

// B shapes.
struct Bent {
    Array<double, 3> points_m, tangents;  // (B, CURVE_NODES, 3)
    Array<double, 2> force_N;             // (B, 3)
    Array<double, 1> moment_Nm;
};

// Shapes of B antennas by a rung of the ladder; sweeps: for the upper rungs.
Bent bend_batch(int rung, int sweeps, const Presses& presses);

}  // namespace vbaa::antenna
