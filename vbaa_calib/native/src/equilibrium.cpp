#include "equilibrium.hpp"

#include <cmath>

#include "pendulum.hpp"

namespace vbaa::antenna {

namespace {

// EI/GJ of a round wire, 1 + ν. Torsion turns the section, and with it the bow: hundredths of a millimetre.
constexpr double TORSION_RATIO = 1.3;

// The clamp's turn about y and z, as half angles.
struct ClampTurn {
    Lanes y, z;
};

// The fields of one equilibrium.
struct Work {
    Hinge hinge;
    Field field;      // g
    Field local;      // τ
    Field moments;    // M
    Field integrand;  // scratch
};

// What the turns make of the loads: Q(0)·R₀ᵀ as a Cayley vector, the contact force along the contact's axes.
struct State {
    Vectors seen, force;
};

// Where integrals go.
auto into(Vectors* field) {
    return [=](std::size_t row, const Vectors& v) { field[row] = v; };
}

// Length beyond the node.
Lanes beyond(const Loads& loads, int node) {
    const NodeTables& tables = node_tables();
    if (node < INNER_NODES) return loads.length_m - loads.contact_m * spread(tables.inner[node]);
    return (loads.length_m - loads.contact_m) * spread(1.0 - tables.outer[node - INNER_NODES]);
}

// Length of the side of the contact that the node lies on.
Lanes side(const Loads& loads, int node) {
    return node < INNER_NODES ? loads.contact_m : loads.length_m - loads.contact_m;
}

// H·v.
Vectors hinged(const Hinge& hinge, int node, Vectors v) {
    Lanes sine = hinge.sine[node], cosine = hinge.cosine[node];
    return {cosine * v.x - sine * v.y, sine * v.x + cosine * v.y, v.z};
}

// Hᵀ·v.
Vectors hinged_back(const Hinge& hinge, int node, Vectors v) {
    Lanes sine = hinge.sine[node], cosine = hinge.cosine[node];
    return {cosine * v.x + sine * v.y, cosine * v.y - sine * v.x, v.z};
}

// Q·v of the Cayley vector g.
Vectors turned(Vectors g, Vectors v) {
    Vectors once = cross(g, v);
    return v + 2.0 / (1.0 + dot(g, g)) * (once + cross(g, once));
}

// Q e_x of the Cayley vector g.
Vectors turned_x(Vectors g) {
    Lanes across = g.y * g.y + g.z * g.z, scale = 2.0 / (1.0 + g.x * g.x + across);
    return {1.0 - scale * across, scale * (g.x * g.y + g.z), scale * (g.x * g.z - g.y)};
}

// Cayley vector of Q(0)·R₀ᵀ.
Vectors seen_from_contact(const Field& field, ClampTurn clamp) {
    Vectors g = field[0];
    Vectors found = {g.x + g.z * clamp.y - g.y * clamp.z, g.y - clamp.y + g.x * clamp.z, g.z - clamp.z - g.x * clamp.y};
    return 1.0 / (1.0 + g.y * clamp.y + g.z * clamp.z) * found;
}

// Loads beyond the series: in closed form, lane by lane.
void hinge_in_closed_form(Lanes amounts, Lanes frictions, Hinge& hinge) {
    for (int lane = 0; lane < LANES; ++lane) {
        double amount = amounts[lane], friction = frictions[lane];
        if (!(amount > SERIES_LOAD)) continue;
        // most lanes are the same shape again, where what does not bend it is moved
        bool same = lane > 0 && amount == amounts[0] && friction == frictions[0];
        Landen chain;
        if (!same) chain = landen(0.5 * (1.0 - std::sin(friction)));
        double root = std::sqrt(amount);
        for (int node = 0; node < INNER_NODES - 1; ++node) {
            if (same) {
                hinge.sine[node][lane] = hinge.sine[node][0];
                hinge.cosine[node][lane] = hinge.cosine[node][0];
                hinge.slope[node][lane] = hinge.slope[node][0];
                continue;
            }
            UniversalPoint at = closed_form(root * (1.0 - node_tables().inner[node]), friction, chain);
            hinge.sine[node][lane] = -std::sin(at.psi);
            hinge.cosine[node][lane] = std::cos(at.psi);
            hinge.slope[node][lane] = (at.along * std::cos(friction) - at.across * std::sin(friction)) / root;
        }
    }
}

// The elastica's rotations from the contact's section to those at the nodes: −ψ.
void elastica_hinge(const Loads& loads, Hinge& hinge) {
    SineCosine friction = sine_and_cosine(loads.friction_rad);
    Lanes force = loads.push_per_m2 / friction.cosine, steepness = force * loads.contact_m;
    Lanes amounts = steepness * loads.contact_m, small = amounts;
    double largest = 0.0;
    for (int lane = 0; lane < LANES; ++lane) {
        if (small[lane] > SERIES_LOAD) small[lane] = 0.0;
        if (small[lane] > largest) largest = small[lane];
    }
    hinge_by_series(small, friction, series_terms(largest), hinge);
    hinge_in_closed_form(amounts, loads.friction_rad, hinge);
    for (int node = 0; node < INNER_NODES - 1; ++node) hinge.slope[node] *= steepness;
    for (int node = INNER_NODES - 1; node < NODES; ++node) {
        hinge.sine[node] = hinge.slope[node] = Lanes{};
        hinge.cosine[node] = spread(1.0);
    }
}

// The sections turned about their own axes until the clamp's turn to the contact's axes has no roll in it.
void roll_out(Work& work, ClampTurn clamp) {
    Vectors seen = seen_from_contact(work.field, clamp);
    Lanes roll = work.hinge.sine[0] / (1.0 + work.hinge.cosine[0]) * seen.y - seen.x;
    for (Vectors& g : work.field) g.x += roll;
}

// Half the turns about y and z of a straight antenna that weight and bow bend a little.
ClampTurn bent_a_little(const Loads& loads, int node) {
    Lanes length = loads.length_m;
    Lanes rest = beyond(loads, node), along = length - rest;
    Lanes by_weight = (length * length * length - rest * rest * rest) / 6.0;
    return {0.5 * (along * loads.bow_y_per_m - by_weight * loads.weight_per_m3.z),
            0.5 * (along * loads.bow_z_per_m + by_weight * loads.weight_per_m3.y)};
}

// The turns of a straight antenna that weight, bow and its clamp's give bend a little.
ClampTurn first_turns(const Loads& loads, Work& work) {
    ClampTurn contact = bent_a_little(loads, INNER_NODES - 1);
    for (int node = 0; node < NODES; ++node) {
        ClampTurn here = bent_a_little(loads, node);
        work.field[node] = {-work.hinge.sine[node] * contact.y, here.y - work.hinge.cosine[node] * contact.y,
                            here.z - contact.z};
    }
    Lanes half_give = 0.5 * loads.give_m, half_square = 0.5 * loads.length_m * loads.length_m;
    ClampTurn clamp = {-half_give * (half_square * loads.weight_per_m3.z),
                       half_give * (half_square * loads.weight_per_m3.y + loads.contact_m * loads.push_per_m2)};
    roll_out(work, clamp);
    return clamp;
}

// The moments of the present turns; writes τ, t and M.
State state_of(const Loads& loads, Work& work, ClampTurn clamp, Field& tangents) {
    const Hinge& hinge = work.hinge;
    Vectors seen = seen_from_contact(work.field, clamp);
    Vectors weight = hinged(hinge, 0, turned(seen, loads.weight_per_m3));
    SineCosine friction = sine_and_cosine(loads.friction_rad);
    Vectors force = {-loads.push_per_m2 * (friction.sine / friction.cosine), loads.push_per_m2, Lanes{}};
    if (loads.dead)
        force = hinged(hinge, 0, turned(seen, Vectors{loads.dead_along_per_m2, loads.push_per_m2, Lanes{}}));
    for (int node = 0; node < NODES; ++node) {
        work.local[node] = turned_x(work.field[node]);
        tangents[node] = hinged(hinge, node, work.local[node]);
        Vectors internal = beyond(loads, node) * weight;
        if (node < INNER_NODES) internal = internal + force;
        work.integrand[node] = side(loads, node) * cross(tangents[node], internal);
    }
    const NodeTables& tables = node_tables();
    Field& moments = work.moments;
    integrated(tables.outer_from_tip, &work.integrand[INNER_NODES], Vectors{}, into(&moments[INNER_NODES]));
    // the first node beyond the contact is the contact itself
    integrated(tables.inner_from_tip, work.integrand.data(), moments[INNER_NODES], into(moments.data()));
    return {seen, force};
}

// 2 g′.
Vectors rate(const Loads& loads, Vectors g, Vectors local, Vectors m, Lanes curvature_per_m) {
    Vectors delta = {m.x, m.y, m.z - curvature_per_m};
    Vectors b = {(TORSION_RATIO - 1.0) * dot(local, m), loads.bow_y_per_m, loads.bow_z_per_m};
    Vectors both = delta + b;
    return both - cross(g, delta - b) + dot(g, both) * g;
}

// The turns under the moments of the present ones: writes g, gives the clamp's.
ClampTurn swept(const Loads& loads, Work& work, Vectors seen) {
    const Hinge& hinge = work.hinge;
    Vectors at_clamp = turned(-seen, hinged_back(hinge, 0, work.moments[0]));
    Lanes half_give = 0.5 * loads.give_m;
    for (int node = 0; node < NODES; ++node) {
        Vectors m = hinged_back(hinge, node, work.moments[node]);
        Vectors change = rate(loads, work.field[node], work.local[node], m, hinge.slope[node]);
        work.integrand[node] = 0.5 * side(loads, node) * change;
    }
    const NodeTables& tables = node_tables();
    Field& field = work.field;
    Vectors at_contact = {field[INNER_NODES - 1].x, Lanes{}, Lanes{}};
    integrated(tables.inner_from_contact, work.integrand.data(), at_contact, into(field.data()));
    integrated(tables.outer_from_contact, &work.integrand[INNER_NODES], at_contact, into(&field[INNER_NODES]));
    ClampTurn clamp = {half_give * at_clamp.y, half_give * at_clamp.z};
    roll_out(work, clamp);
    return clamp;
}

}  // namespace

Equilibrium equilibrium(const Loads& loads, int sweeps, Field& tangents) {
    Work work;
    elastica_hinge(loads, work.hinge);
    ClampTurn clamp = first_turns(loads, work);
    State state = state_of(loads, work, clamp, tangents);
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        clamp = swept(loads, work, state.seen);
        state = state_of(loads, work, clamp, tangents);
    }
    Lanes sine = work.hinge.sine[0], cosine = work.hinge.cosine[0];
    Vectors x_axis = turned(-state.seen, Vectors{cosine, -sine, Lanes{}});
    Vectors y_axis = turned(-state.seen, Vectors{sine, cosine, Lanes{}});
    return {{x_axis, y_axis, cross(x_axis, y_axis)}, state.force, work.moments[0]};
}

}  // namespace vbaa::antenna
