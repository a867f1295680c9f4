#include "equilibrium_sweeps.hpp"

namespace vbaa::antenna {

using sweep::found_by_sweeps;

namespace {

// A function that stores integrals in a field.
auto into(Vectors* field) {
    return [=](std::size_t row, const Vectors& v) { field[row] = v; };
}

// Nodes of a uniform antenna, with their integration weights.
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
    // Rotation of a straight antenna at a node by its weight, and the weight's moment at the clamp, per unit.
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

// The elastica's rotations for loads beyond the series: in closed form, lane by lane.
void hinge_in_closed_form(Lanes amounts, Lanes frictions, Hinge& hinge) {
    for (int lane = 0; lane < LANES; ++lane) {
        double amount = amounts[lane], friction = frictions[lane];
        if (!(amount > SERIES_LOAD)) continue;
        // most lanes repeat the same shape, with a change that does not bend it
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

}  // namespace

Equilibrium equilibrium(const Loads& loads, int sweeps, Field& tangents) {
    return found_by_sweeps(loads, Even(loads), sweeps, tangents);
}

}  // namespace vbaa::antenna
