// The sweeps of equilibrium.hpp, over the nodes of any antenna: a class of nodes says where they lie, how to integrate
// over them, and what lies beyond each.
#pragma once

#include <cmath>

#include "equilibrium.hpp"
#include "pendulum.hpp"

namespace vbaa::antenna::sweep {

// EI/GJ of a round wire, 1 + ν. Torsion turns the section, and with it the bow: hundredths of a millimetre.
constexpr double TORSION_RATIO = 1.3;

// Whether sweeps have converged in all lanes, by the squares of the last two changes of the ends. Convergence is
// linear: the remaining error is about the last change times its ratio to the one before.
inline bool at_rest(const Lanes& square, const Lanes& before) {
    constexpr double rad = 1e-10;  // of half an angle: moves points by far less than a nanometre
    return sum(choose(square * square <= rad * rad * before, spread(0.0), spread(1.0))) == 0.0;
}

// The clamp's turn about y and z, as half angles.
struct ClampTurn {
    Lanes y, z;
};

// The fields of one equilibrium.
template <int COUNT>
struct Work {
    HingeAt<COUNT> hinge;
    std::array<Vectors, COUNT> field;      // g
    std::array<Vectors, COUNT> local;      // τ
    std::array<Vectors, COUNT> moments;    // M
    std::array<Vectors, COUNT> integrand;  // scratch
};

// The loads under the present rotations: Q(0)·R₀ᵀ as a Cayley vector, and the contact force along the contact's axes.
struct State {
    Vectors seen, force;
};

// The product H·v.
template <int COUNT>
Vectors hinged(const HingeAt<COUNT>& hinge, int node, Vectors v) {
    Lanes sine = hinge.sine[node], cosine = hinge.cosine[node];
    return {cosine * v.x - sine * v.y, sine * v.x + cosine * v.y, v.z};
}

// The product Hᵀ·v.
template <int COUNT>
Vectors hinged_back(const HingeAt<COUNT>& hinge, int node, Vectors v) {
    Lanes sine = hinge.sine[node], cosine = hinge.cosine[node];
    return {cosine * v.x + sine * v.y, cosine * v.y - sine * v.x, v.z};
}

// Q·v of the Cayley vector g.
inline Vectors turned(Vectors g, Vectors v) {
    Vectors once = cross(g, v);
    return v + 2.0 / (1.0 + dot(g, g)) * (once + cross(g, once));
}

// Q e_x of the Cayley vector g.
inline Vectors turned_x(Vectors g) {
    Lanes across = g.y * g.y + g.z * g.z, scale = 2.0 / (1.0 + g.x * g.x + across);
    return {1.0 - scale * across, scale * (g.x * g.y + g.z), scale * (g.x * g.z - g.y)};
}

// Cayley vector of Q(0)·R₀ᵀ.
inline Vectors seen_from_contact(Vectors g, ClampTurn clamp) {
    Vectors found = {g.x + g.z * clamp.y - g.y * clamp.z, g.y - clamp.y + g.x * clamp.z, g.z - clamp.z - g.x * clamp.y};
    return 1.0 / (1.0 + g.y * clamp.y + g.z * clamp.z) * found;
}

// Turns all sections about their own axes so that the clamp's rotation to the contact's axes has no roll.
template <int COUNT>
void roll_out(Work<COUNT>& work, int count, ClampTurn clamp) {
    Vectors seen = seen_from_contact(work.field[0], clamp);
    Lanes roll = work.hinge.sine[0] / (1.0 + work.hinge.cosine[0]) * seen.y - seen.x;
    for (int node = 0; node < count; ++node) work.field[node].x += roll;
}

// Half the turns about y and z of a straight antenna that weight and bow bend a little.
template <class Nodes>
ClampTurn bent_a_little(const Loads& loads, const Nodes& nodes, int node) {
    Lanes along = nodes.along(node), by_weight = nodes.weighed(node);
    return {0.5 * (along * loads.bow_y_per_m - by_weight * loads.weight_per_m3.z),
            0.5 * (along * loads.bow_z_per_m + by_weight * loads.weight_per_m3.y)};
}

// The turns of a straight antenna that weight, bow and its clamp's give bend a little.
template <class Nodes>
ClampTurn first_turns(const Loads& loads, const Nodes& nodes, Work<Nodes::MOST>& work) {
    ClampTurn contact = bent_a_little(loads, nodes, nodes.inner() - 1);
    for (int node = 0; node < nodes.count(); ++node) {
        ClampTurn here = bent_a_little(loads, nodes, node);
        work.field[node] = {-work.hinge.sine[node] * contact.y, here.y - work.hinge.cosine[node] * contact.y,
                            here.z - contact.z};
    }
    Lanes half_give = 0.5 * loads.give_m, half_square = nodes.weighed_at_clamp();
    ClampTurn clamp = {-half_give * (half_square * loads.weight_per_m3.z),
                       half_give * (half_square * loads.weight_per_m3.y + loads.contact_m * loads.push_per_m2)};
    roll_out(work, nodes.count(), clamp);
    return clamp;
}

// The moments of the present turns; writes τ, t and M.
template <class Nodes>
State state_of(const Loads& loads, const Nodes& nodes, Work<Nodes::MOST>& work, ClampTurn clamp,
               std::array<Vectors, Nodes::MOST>& tangents) {
    const auto& hinge = work.hinge;
    Vectors seen = seen_from_contact(work.field[0], clamp);
    Vectors weight = hinged(hinge, 0, turned(seen, loads.weight_per_m3));
    SineCosine friction = sine_and_cosine(loads.friction_rad);
    Vectors force = {-loads.push_per_m2 * (friction.sine / friction.cosine), loads.push_per_m2, Lanes{}};
    if (loads.dead)
        force = hinged(hinge, 0, turned(seen, Vectors{loads.dead_along_per_m2, loads.push_per_m2, Lanes{}}));
    for (int node = 0; node < nodes.count(); ++node) {
        work.local[node] = turned_x(work.field[node]);
        tangents[node] = hinged(hinge, node, work.local[node]);
        Vectors internal = nodes.beyond(node) * weight;
        if (node < nodes.inner()) internal = internal + force;
        work.integrand[node] = nodes.side(node) * cross(tangents[node], internal);
    }
    nodes.from_tip(work.integrand.data(), work.moments.data());
    return {seen, force};
}

// The derivative g′, times 2.
inline Vectors rate(const Loads& loads, Vectors g, Vectors local, Vectors m, Lanes curvature_per_m) {
    Vectors delta = {m.x, m.y, m.z - curvature_per_m};
    Vectors b = {(TORSION_RATIO - 1.0) * dot(local, m), loads.bow_y_per_m, loads.bow_z_per_m};
    Vectors both = delta + b;
    return both - cross(g, delta - b) + dot(g, both) * g;
}

// The turns under the moments of the present ones: writes g, gives the clamp's.
template <class Nodes>
ClampTurn swept(const Loads& loads, const Nodes& nodes, Work<Nodes::MOST>& work, Vectors seen) {
    const auto& hinge = work.hinge;
    Vectors at_clamp = turned(-seen, hinged_back(hinge, 0, work.moments[0]));
    Lanes half_give = 0.5 * loads.give_m;
    for (int node = 0; node < nodes.count(); ++node) {
        Vectors m = hinged_back(hinge, node, work.moments[node]);
        if constexpr (!Nodes::UNIFORM) m = nodes.flexibility(node) * m;
        Vectors change = rate(loads, work.field[node], work.local[node], m, hinge.slope[node]);
        work.integrand[node] = 0.5 * nodes.side(node) * change;
    }
    Vectors at_contact = {work.field[nodes.inner() - 1].x, Lanes{}, Lanes{}};
    nodes.from_contact(work.integrand.data(), at_contact, work.field.data());
    ClampTurn clamp = {half_give * at_clamp.y, half_give * at_clamp.z};
    roll_out(work, nodes.count(), clamp);
    return clamp;
}

template <class Nodes>
Equilibrium found_by_sweeps(const Loads& loads, const Nodes& nodes, int sweeps,
                            std::array<Vectors, Nodes::MOST>& tangents) {
    Work<Nodes::MOST> work;
    elastica_hinge(loads, nodes, work.hinge);
    ClampTurn clamp = first_turns(loads, nodes, work);
    State state = state_of(loads, nodes, work, clamp, tangents);
    const int tip = nodes.count() - 1;
    Lanes before = spread(0.0);
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        const Vectors clamp_was = work.field[0], tip_was = work.field[tip];
        clamp = swept(loads, nodes, work, state.seen);
        state = state_of(loads, nodes, work, clamp, tangents);
        const Vectors at_clamp = work.field[0] - clamp_was, at_tip = work.field[tip] - tip_was;
        const Lanes square = dot(at_clamp, at_clamp) + dot(at_tip, at_tip);
        if (at_rest(square, before)) break;
        before = square;
    }
    Lanes sine = work.hinge.sine[0], cosine = work.hinge.cosine[0];
    Vectors x_axis = turned(-state.seen, Vectors{cosine, -sine, Lanes{}});
    Vectors y_axis = turned(-state.seen, Vectors{sine, cosine, Lanes{}});
    return {{x_axis, y_axis, cross(x_axis, y_axis)}, state.force, work.moments[0]};
}

}  // namespace vbaa::antenna::sweep
