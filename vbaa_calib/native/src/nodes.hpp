// Where an antenna's shape is computed and where it is written, and the matrices between the two.
//
// Either side of the contact the shape is smooth, so it is computed at a few Chebyshev nodes on each and integrated as
// the polynomial through them. The contact is a node of both sides, since forces jump there. It is written at the
// denser nodes of a curve.
#pragma once

#include <array>

#include "lanes.hpp"

namespace vbaa::antenna {

// Nodes at which a shape is written: evenly from the clamp to the contact, both included, and beyond it to the tip.
constexpr int NODES_TO_CONTACT = 40, NODES_BEYOND = 21, CURVE_NODES = NODES_TO_CONTACT + NODES_BEYOND;
constexpr int CONTACT = NODES_TO_CONTACT - 1;
// Rows of eight for all nodes of one shape; those to the contact fill theirs.
constexpr int NODE_ROWS = whole_lanes(CURVE_NODES) / LANES, INNER_ROWS = NODES_TO_CONTACT / LANES;
static_assert(NODES_TO_CONTACT % LANES == 0);
// Nodes at which a shape is computed, from the clamp to the contact and from there to the tip: as many as keep what
// they lose a tenth below what four sweeps leave (shapes.hpp).
constexpr int INNER_NODES = 10, OUTER_NODES = 7, NODES = INNER_NODES + OUTER_NODES;
// Least distance of a contact from the tip, over the length: at the tip itself no antenna is left beyond it.
constexpr double NEAREST_TO_TIP = 1e-6;

template <int ROWS, int COLUMNS>
using Weights = std::array<std::array<double, COLUMNS>, ROWS>;

struct NodeTables {
    static constexpr int PANEL = 9;  // nodes of each panel of an antenna that is not uniform, see taper.hpp

    // Chebyshev-Lobatto nodes from 0 to 1, ends included
    std::array<double, INNER_NODES> inner;
    std::array<double, OUTER_NODES> outer;
    // from values times their side's length to integrals: from the contact, and to the side's farther end
    Weights<INNER_NODES, INNER_NODES> inner_from_contact, inner_from_tip;
    Weights<OUTER_NODES, OUTER_NODES> outer_from_contact, outer_from_tip;
    // the same on a panel: from its start to each node, from each node to its end, and to powers of x from −1 to 1
    std::array<double, PANEL> panel;
    Weights<PANEL, PANEL> panel_from_start, panel_from_end, panel_powers;
    // to the curve's nodes: values, and values times their side's length to integrals from the side's start
    Weights<NODES_TO_CONTACT, INNER_NODES> at_inner_curve, to_inner_curve;
    Weights<NODES_BEYOND, OUTER_NODES> at_outer_curve, to_outer_curve;
    // the values' weights by node, for eight nodes of the curve at once
    Weights<INNER_NODES, INNER_ROWS * LANES> by_inner_node;
    Weights<OUTER_NODES, (NODE_ROWS - INNER_ROWS) * LANES> by_outer_node;
};

// The tables, computed once.
const NodeTables& node_tables();

// Share of the way from clamp to contact at which a node of the curve lies, or of that from there to the tip.
constexpr double curve_share(int node) {
    return node < NODES_TO_CONTACT ? double(node) / CONTACT : double(node - CONTACT) / NODES_BEYOND;
}

}  // namespace vbaa::antenna
