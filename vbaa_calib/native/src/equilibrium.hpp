// The equilibrium of moments along the antenna, by sweeps over a small rotation field on top of the elastica.
//
// Seen from the contact, where the force on the antenna is known, the sections stand turned by P(s) = H(s)·Q(s): H is
// the elastica's rotation by θ(s) − θ_c about z, Q that of the Cayley vector g(s) = tan(φ/2)·axis, which all other
// loads and the bow need. With the internal force N(s) and its moment M(s), what lies beyond s on what lies before it,
//
//     M(s) = ∫ₛᴸ t × N dσ,    m = Hᵀ M/EI,    δ = m − θ′ e_z,    b = κ₀ + (EI/GJ − 1)(τ·m) e_x,    τ = Q e_x
//     g′ = ½ [(δ + b) − g × (δ − b) + (g·(δ + b)) g],    g(contact) = (roll, 0, 0)
//
// b is what curves the antenna about axes of its own. δ is small: the contact force's moment is nearly all in θ′. What
// is fixed at the clamp, weight and a dead force, is seen from the contact by P(0) R₀ᵀ, where R₀ is the clamp's give.
// The roll is what makes the force's direction follow the antenna by the least rotation. A sweep from the clamp on
// would let every error there swing the contact and its force about; from 90° of slope on such sweeps diverge.
//
// Where the antenna is not uniform, EI is the clamp's, m is c·Hᵀ M/EI with the flexibility c(s) of taper.hpp, and the
// elastica is integrated from the contact.
//
// Clamp's axes: x along the clamped tangent, y along the contact force's lateral part before it is turned. Contact's
// axes: x along the antenna, the force in the plane of x and y. Forces and moments are divided by EI.
#pragma once

#include <array>

#include "nodes.hpp"
#include "taper.hpp"
#include "vectors.hpp"

namespace vbaa::antenna {

// On the nodes of nodes.hpp.
using Field = std::array<Vectors, NODES>;

// A rotation matrix' columns: the axes of one frame along those of another.
struct Frame {
    Vectors x, y, z;

    // from the frame's components to those of its axes
    Vectors turned(Vectors v) const { return v.x * x + v.y * y + v.z * z; }
    // into the frame's components
    Vectors turned_back(Vectors v) const { return {dot(x, v), dot(y, v), dot(z, v)}; }
};

// What bends LANES antennas, along the clamp's axes and over EI.
struct Loads {
    Lanes contact_m;     // arc length of the contact
    Lanes length_m;      // of the antenna
    Lanes push_per_m2;   // the contact force's component along the normal
    Lanes friction_rad;  // angle of the whole force from the normal, positive towards the clamp
    bool dead;           // the force keeps its direction; otherwise it follows the antenna's normal
    Lanes dead_along_per_m2;
    Vectors weight_per_m3;
    Lanes bow_y_per_m, bow_z_per_m;  // natural curvature
    Lanes give_m;                    // of the clamp
};

struct Equilibrium {
    Frame axes;  // the contact's along the clamp's
    // along the contact's axes: the contact force, and the loads' moment at the clamp
    Vectors force_per_m2, moment_per_m;
};

// Sweep so many times, from the rotations that weight and bow cause by themselves; writes the tangents in the contact's
// axes.
Equilibrium equilibrium(const Loads& loads, int sweeps, Field& tangents);

// Part of a taper's panel on one side of the contact, in each lane; some are empty.
struct Part {
    int panel;
    Lanes start_m, width_m;
};
// Nodes of an antenna that is not uniform: those of its parts, from the clamp to the tip.
struct PanelNodes {
    static constexpr int PARTS = 2 * Taper::PANELS, NODES = PARTS * NodeTables::PANEL;

    int inner, count;  // parts before the contact, and all
    std::array<Part, PARTS> parts;
    // flexibility, the weight per length and that beyond, as a uniform antenna's length
    std::array<Lanes, NODES> flexibility, weight, beyond_m;
    // of the weight beyond a node about it, as of a uniform antenna's, and how far that bends the antenna before it
    std::array<Lanes, NODES> weighed_m2, weighed_m3;
};
PanelNodes panel_nodes(const Taper& taper, Lanes contact_m, double length_m);
using PanelField = std::array<Vectors, PanelNodes::NODES>;

// The same for an antenna that is not uniform.
Equilibrium equilibrium(const Loads& loads, const PanelNodes& nodes, int sweeps, PanelField& tangents);

// Pass on base + Σ weight·field, row after row.
//
// Two rows at a time: each vector of the field is fetched once for both, and sixteen registers hold all sums.
template <std::size_t ROWS, std::size_t COUNT, class Take>
void integrated(const std::array<std::array<double, COUNT>, ROWS>& weights, const Vectors* field, Vectors base,
                Take take) {
    std::size_t row = 0;
    for (; row + 1 < ROWS; row += 2) {
        Vectors a = base, b = base;
        for (std::size_t node = 0; node < COUNT; ++node) {
            a = a + weights[row][node] * field[node];
            b = b + weights[row + 1][node] * field[node];
        }
        take(row, a);
        take(row + 1, b);
    }
    if (row < ROWS) {
        for (std::size_t node = 0; node < COUNT; ++node) base = base + weights[row][node] * field[node];
        take(row, base);
    }
}

}  // namespace vbaa::antenna
