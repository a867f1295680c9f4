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

// Where integrals go.
auto into(Vectors* field) {
    return [=](std::size_t row, const Vectors& v) { field[row] = v; };
}

// The nodes of a uniform antenna.
class Even {
  public:
    static constexpr int MOST = NODES;
    static constexpr bool UNIFORM = true;

    explicit Even(const Loads& bent) : loads(bent) {}

    static int count() { return NODES; }
    // of those before the contact, which is the last of them
    static int inner() { return INNER_NODES; }
    Lanes along(int node) const { return loads.length_m - beyond(node); }
    // Length beyond the node.
    Lanes beyond(int node) const {
        const NodeTables& tables = node_tables();
        if (node < INNER_NODES) return loads.length_m - loads.contact_m * spread(tables.inner[node]);
        return (loads.length_m - loads.contact_m) * spread(1.0 - tables.outer[node - INNER_NODES]);
    }
    // Length of the side of the contact that the node lies on.
    Lanes side(int node) const { return node < INNER_NODES ? loads.contact_m : loads.length_m - loads.contact_m; }
    // How the weight bends a straight antenna before a node, and its moment at the clamp.
    Lanes weighed(int node) const {
        Lanes length = loads.length_m, rest = beyond(node);
        return (length * length * length - rest * rest * rest) / 6.0;
    }
    Lanes weighed_at_clamp() const { return 0.5 * loads.length_m * loads.length_m; }

    static void from_tip(const Vectors* integrand, Vectors* found) {
        const NodeTables& tables = node_tables();
        integrated(tables.outer_from_tip, integrand + INNER_NODES, Vectors{}, into(found + INNER_NODES));
        // the first node beyond the contact is the contact itself
        integrated(tables.inner_from_tip, integrand, found[INNER_NODES], into(found));
    }
    static void from_contact(const Vectors* integrand, Vectors at_contact, Vectors* found) {
        const NodeTables& tables = node_tables();
        integrated(tables.inner_from_contact, integrand, at_contact, into(found));
        integrated(tables.outer_from_contact, integrand + INNER_NODES, at_contact, into(found + INNER_NODES));
    }

  private:
    const Loads& loads;
};

// Integrals over a part's nodes, from its end backwards and from its start on; an integrand is multiplied by the width.
template <class T>
void to_end(const T* integrand, T at_end, T* found) {
    for (int i = 0; i < NodeTables::PANEL; ++i) {
        T total = at_end;
        for (int j = 0; j < NodeTables::PANEL; ++j) total = total + node_tables().panel_from_end[i][j] * integrand[j];
        found[i] = total;
    }
}
template <class T>
void from_start(const T* integrand, T at_start, T* found) {
    for (int i = 0; i < NodeTables::PANEL; ++i) {
        T total = at_start;
        for (int j = 0; j < NodeTables::PANEL; ++j) total = total + node_tables().panel_from_start[i][j] * integrand[j];
        found[i] = total;
    }
}

// The nodes of one that is not.
class Uneven {
  public:
    static constexpr int MOST = PanelNodes::NODES;
    static constexpr bool UNIFORM = false;

    explicit Uneven(const PanelNodes& of) : nodes(of) {}

    int count() const { return nodes.count * NodeTables::PANEL; }
    int inner() const { return nodes.inner * NodeTables::PANEL; }
    Lanes along(int node) const {
        const Part& part = nodes.parts[node / NodeTables::PANEL];
        return part.start_m + node_tables().panel[node % NodeTables::PANEL] * part.width_m;
    }
    Lanes beyond(int node) const { return nodes.beyond_m[node]; }
    Lanes side(int node) const { return nodes.parts[node / NodeTables::PANEL].width_m; }
    Lanes weighed(int node) const { return nodes.weighed_m3[node]; }
    Lanes weighed_at_clamp() const { return nodes.weighed_m2[0]; }
    Lanes flexibility(int node) const { return nodes.flexibility[node]; }

    void from_tip(const Vectors* integrand, Vectors* found) const {
        Vectors at_end = {};
        for (int first = count() - NodeTables::PANEL; first >= 0; first -= NodeTables::PANEL) {
            to_end(integrand + first, at_end, found + first);
            at_end = found[first];
        }
    }
    void from_contact(const Vectors* integrand, Vectors at_contact, Vectors* found) const {
        Vectors at = at_contact;
        for (int first = inner() - NodeTables::PANEL; first >= 0; first -= NodeTables::PANEL) {
            std::array<Vectors, NodeTables::PANEL> back;
            to_end(integrand + first, Vectors{}, back.data());
            for (int i = 0; i < NodeTables::PANEL; ++i) found[first + i] = at - back[i];
            at = found[first];
        }
        at = at_contact;
        for (int first = inner(); first < count(); first += NodeTables::PANEL) {
            from_start(integrand + first, at, found + first);
            at = found[first + NodeTables::PANEL - 1];
        }
    }

  private:
    const PanelNodes& nodes;
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

// What the turns make of the loads: Q(0)·R₀ᵀ as a Cayley vector, the contact force along the contact's axes.
struct State {
    Vectors seen, force;
};

// H·v.
template <int COUNT>
Vectors hinged(const HingeAt<COUNT>& hinge, int node, Vectors v) {
    Lanes sine = hinge.sine[node], cosine = hinge.cosine[node];
    return {cosine * v.x - sine * v.y, sine * v.x + cosine * v.y, v.z};
}

// Hᵀ·v.
template <int COUNT>
Vectors hinged_back(const HingeAt<COUNT>& hinge, int node, Vectors v) {
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
Vectors seen_from_contact(Vectors g, ClampTurn clamp) {
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
void elastica_hinge(const Loads& loads, const Even&, Hinge& hinge) {
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

// How far a tangent lags the contact's, and the moment there over EI.
struct Pendulum {
    Lanes psi, moment;
};

// The elastica on a part from its end back, ψ′ = c·m and m′ = F cos(ψ + α), by Picard's iteration; gives its start.
Pendulum hinge_of_part(const Uneven& nodes, int first, Lanes force, Lanes friction_rad, Pendulum end,
                       HingeAt<PanelNodes::NODES>& hinge) {
    // in so many turns ψ changes by less at last, and no antenna lags by more
    constexpr int MOST_TURNS = 40;
    constexpr double SAME_PSI = 1e-12, MOST_PSI = 3.0;
    std::array<Lanes, NodeTables::PANEL> psi, moment, integrand;
    Lanes width = nodes.side(first);
    // straight at first
    psi.fill(end.psi);
    for (int turn = 0; turn < MOST_TURNS; ++turn) {
        for (int i = 0; i < NodeTables::PANEL; ++i) {
            SineCosine half = sine_and_cosine(0.5 * (psi[i] + friction_rad));
            integrand[i] = width * force * (1.0 - 2.0 * half.sine * half.sine);
        }
        to_end(integrand.data(), end.moment, moment.data());
        for (int i = 0; i < NodeTables::PANEL; ++i) {
            integrand[i] = width * nodes.flexibility(first + i) * moment[i];
        }
        std::array<Lanes, NodeTables::PANEL> next;
        to_end(integrand.data(), end.psi, next.data());
        bool same = true;
        for (int i = 0; i < NodeTables::PANEL; ++i) {
            // what is far beyond any antenna must stay a number
            next[i] = where_positive(next[i] - MOST_PSI, MOST_PSI, next[i]);
            next[i] = where_positive(-MOST_PSI - next[i], -MOST_PSI, next[i]);
            const Lanes change = absolute(next[i] - psi[i]);
            for (int lane = 0; lane < LANES; ++lane) same = same && !(change[lane] > SAME_PSI);
        }
        psi = next;
        if (same) break;
    }
    for (int i = 0; i < NodeTables::PANEL; ++i) {
        SineCosine half = sine_and_cosine(0.5 * psi[i]);
        hinge.sine[first + i] = -2.0 * half.sine * half.cosine;
        hinge.cosine[first + i] = 1.0 - 2.0 * half.sine * half.sine;
        hinge.slope[first + i] = nodes.flexibility(first + i) * moment[i];
    }
    return {psi[0], moment[0]};
}

// The same of an antenna that is not uniform.
void elastica_hinge(const Loads& loads, const Uneven& nodes, HingeAt<PanelNodes::NODES>& hinge) {
    Lanes force = loads.push_per_m2 / sine_and_cosine(loads.friction_rad).cosine;
    Pendulum at = {};
    for (int first = nodes.inner() - NodeTables::PANEL; first >= 0; first -= NodeTables::PANEL)
        at = hinge_of_part(nodes, first, force, loads.friction_rad, at, hinge);
    for (int node = nodes.inner(); node < nodes.count(); ++node) {
        hinge.sine[node] = hinge.slope[node] = Lanes{};
        hinge.cosine[node] = spread(1.0);
    }
}

// The sections turned about their own axes until the clamp's turn to the contact's axes has no roll in it.
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

// 2 g′.
Vectors rate(const Loads& loads, Vectors g, Vectors local, Vectors m, Lanes curvature_per_m) {
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
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        clamp = swept(loads, nodes, work, state.seen);
        state = state_of(loads, nodes, work, clamp, tangents);
    }
    Lanes sine = work.hinge.sine[0], cosine = work.hinge.cosine[0];
    Vectors x_axis = turned(-state.seen, Vectors{cosine, -sine, Lanes{}});
    Vectors y_axis = turned(-state.seen, Vectors{sine, cosine, Lanes{}});
    return {{x_axis, y_axis, cross(x_axis, y_axis)}, state.force, work.moments[0]};
}

}  // namespace

Equilibrium equilibrium(const Loads& loads, int sweeps, Field& tangents) {
    return found_by_sweeps(loads, Even(loads), sweeps, tangents);
}

Equilibrium equilibrium(const Loads& loads, const PanelNodes& nodes, int sweeps, PanelField& tangents) {
    return found_by_sweeps(loads, Uneven(nodes), sweeps, tangents);
}

PanelNodes panel_nodes(const Taper& taper, Lanes contact_m, double length_m) {
    PanelNodes nodes;
    nodes.count = 0;
    // what is not a number in the second is none
    const auto nearer = [](Lanes a, Lanes b) { return where_positive(b - a, a, b); };
    const auto farther = [](Lanes a, Lanes b) { return where_positive(a - b, a, b); };
    const auto add = [&](int k, Lanes start, Lanes end, bool always) {
        const Lanes width = end - start;
        bool empty = true;
        for (int lane = 0; lane < LANES; ++lane) empty = empty && width[lane] == 0.0;
        if (!empty || always) nodes.parts[nodes.count++] = {k, start, width};
    };
    for (int k = 0; k < taper.count; ++k) {
        const Lanes start = spread(taper.panels[k].start * length_m), end = spread(taper.panels[k].end * length_m);
        add(k, nearer(start, contact_m), nearer(end, contact_m), k == 0);
    }
    nodes.inner = nodes.count;
    for (int k = 0; k < taper.count; ++k) {
        const Lanes start = spread(taper.panels[k].start * length_m), end = spread(taper.panels[k].end * length_m);
        add(k, farther(start, contact_m), farther(end, contact_m), k == taper.count - 1);
    }
    for (int p = 0; p < nodes.count; ++p) {
        const Part& part = nodes.parts[p];
        const Panel& panel = taper.panels[part.panel];
        for (int i = 0; i < NodeTables::PANEL; ++i) {
            Lanes place = (part.start_m + node_tables().panel[i] * part.width_m) / length_m;
            place = farther(nearer(place, spread(panel.end)), spread(panel.start));
            nodes.flexibility[p * NodeTables::PANEL + i] = flexibility(panel, place);
            nodes.weight[p * NodeTables::PANEL + i] = weight_at(panel, place);
        }
    }
    std::array<Lanes, NodeTables::PANEL> integrand;
    Lanes beyond = {}, weighed = {};
    for (int first = (nodes.count - 1) * NodeTables::PANEL; first >= 0; first -= NodeTables::PANEL) {
        const Lanes width = nodes.parts[first / NodeTables::PANEL].width_m;
        for (int i = 0; i < NodeTables::PANEL; ++i) integrand[i] = width * nodes.weight[first + i];
        to_end(integrand.data(), beyond, &nodes.beyond_m[first]);
        for (int i = 0; i < NodeTables::PANEL; ++i) integrand[i] = width * nodes.beyond_m[first + i];
        to_end(integrand.data(), weighed, &nodes.weighed_m2[first]);
        beyond = nodes.beyond_m[first];
        weighed = nodes.weighed_m2[first];
    }
    Lanes bent = {};
    for (int first = 0; first < nodes.count * NodeTables::PANEL; first += NodeTables::PANEL) {
        const Lanes width = nodes.parts[first / NodeTables::PANEL].width_m;
        for (int i = 0; i < NodeTables::PANEL; ++i)
            integrand[i] = width * nodes.flexibility[first + i] * nodes.weighed_m2[first + i];
        from_start(integrand.data(), bent, &nodes.weighed_m3[first]);
        bent = nodes.weighed_m3[first + NodeTables::PANEL - 1];
    }
    return nodes;
}

}  // namespace vbaa::antenna
