// The static rod of vbaa_calib/antenna/rod.py: integration of one rod from clamp to tip, and the solve for a tip moment
// of 0.
#pragma once

#include <vector>

#include "arrays.hpp"
#include "vectors.hpp"

namespace vbaa::antenna {

// Runge-Kutta steps from the clamp to the contact, and again from there to the tip.
constexpr int STEPS_PER_SEGMENT = 32;

// On the moment left at the tip, relative to the moment of the loads.
constexpr double ROD_TOLERANCE = 1e-11;

// A short slice of a rod that is not uniform: diameter and a root of the stiffness at its ends, over the clamp's.
struct Slice {
    double start_m, end_m;
    double diameters[2], roots[2];
    int power;             // of the root
    double mass_beyond_m;  // its own and what lies beyond, as a length of the clamp's mass per length
};

struct Rod {
    double length_m;     // from the clamp to the tip
    double bend, twist;  // 1/EI and 1/GJ, at the clamp as the next
    double mass_per_length_kg_m;
    double curvature_y, curvature_z;  // natural curvature, 1/m
    Point origin, d1, d2;             // of the clamp
    std::vector<Slice> slices;        // none: uniform
};

// Slices, short enough for Runge and Kutta, of pieces (P, 7): start, end, diameters, roots at both in parts of length
// and clamp, which root.
std::vector<Slice> slices_of(ConstMatrix pieces, double length_m);

// Diameter at arc lengths over the clamp's.
Lanes diameter_at(const Rod& rod, const Lanes& arclength_m);

// Loads on eight rods: weight, and a force at an arc length from the clamp.
struct RodLoads {
    Point gravity_m_s2;
    Vectors force_N;
    Lanes contact_m;
};

struct Shots {
    Vectors contact_m, tangent;  // of the contact
    Vectors tip_moment_Nm;
};

// Integrate eight rods from the clamp with supposed moments there; in equilibrium the tip's comes out as zero.
//
// By Runge and Kutta over two segments of so many equal steps that meet at the contact. A contact at the tip leaves no
// second segment; the rod is then split in its middle. Writes 2·steps + 1 nodes (N, 4, 3) of the first rod unless
// `nodes` is null: position, tangent d1, director d2 and moment, antenna frame.
//
// A rod that is not uniform is integrated from its tip, where from the clamp on a soft end would multiply every error:
// in place of the clamp's moment its tip's turn from the clamp is supposed, in place of the tip's moment that of the
// clamp is left, both as rotation vectors times EI/L.
Shots shoot(const Rod& rod, const RodLoads& loads, Vectors moment_Nm, int steps, double* nodes = nullptr);

// Nodes (B, N, 4, 3), as above, of B rods under loads (B, 7), gravity, force and the arc length at which it acts, from
// supposed clamp moments (B, 3).
Array<double, 4> shoot_rods(const Rod& rod, ConstMatrix loads, ConstMatrix moment_Nm, int steps);

// B rods.
struct Rods {
    Array<double, 4> nodes;      // (B, N, 4, 3) as in shoot
    Array<double, 2> moment_Nm;  // (B, 3) at the clamp
    Array<double, 1> left;       // (B,) moment left at the tip, relative
};

// Rods in equilibrium, each by itself; where Newton fails at once the load is brought on in shares.
//
// loads: (B, 7) as above. unit_Nm: EI/L. limit_Nm: (B, 2) bound of the clamp moment's components, and unit of the tip's
// moment. moment_Nm: (B, 3) the clamp's moment to start from.
Rods solve_rods(const Rod& rod, ConstMatrix loads, double unit_Nm, ConstMatrix limit_Nm, ConstMatrix moment_Nm,
                int steps);

// Uniform rods touched twice, in equilibrium, each by itself.
//
// loads: (B, 11) gravity, and of the nearer and the farther contact arc length, force along the clamp's y and z, and
// friction angle; the force along x follows from that angle at the bent rod. give_m: as `Rod.clamp_give_m` in Python.
// start: (B, 5) clamp moment in EI/L and forces along x in EI/L² to begin with. Gives nodes (B, 3·steps + 1, 4, 3) as
// in shoot, over three segments that meet at the contacts, the solutions (B, 5), and the residuals (B,).
struct TouchedTwice {
    Array<double, 4> nodes;
    Array<double, 2> solution;
    Array<double, 1> left;
};
TouchedTwice solve_touched_twice(const Rod& rod, ConstMatrix loads, double give_m, ConstMatrix start, int steps);

}  // namespace vbaa::antenna
