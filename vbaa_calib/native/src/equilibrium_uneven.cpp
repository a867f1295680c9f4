#include "equilibrium_sweeps.hpp"

namespace vbaa::antenna {

using sweep::found_by_sweeps;

namespace {

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

// Nodes of a tapered antenna, with their integration weights.
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

// State of the elastica at a place: the angle by which the tangent lags the contact's, and the moment over EI.
struct Pendulum {
    Lanes psi, moment;
};

// The elastica on a part from its end back, ψ′ = c·m and m′ = F cos(ψ + α), by Picard's iteration; gives its start.
Pendulum hinge_of_part(const Uneven& nodes, int first, Lanes force, Lanes friction_rad, Pendulum end,
                       HingeAt<PanelNodes::NODES>& hinge) {
    // iterations after which ψ has converged, and largest lag of any antenna
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
            // keeps ψ finite far beyond any antenna
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

// The elastica's rotations at the nodes of a tapered antenna.
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

}  // namespace

Equilibrium equilibrium(const Loads& loads, const PanelNodes& nodes, int sweeps, PanelField& tangents) {
    return found_by_sweeps(loads, Uneven(nodes), sweeps, tangents);
}

PanelNodes panel_nodes(const Taper& taper, Lanes contact_m, double length_m) {
    PanelNodes nodes;
    nodes.count = 0;
    // NaN in the second argument counts as absent
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
