#include "nodes.hpp"

#include <cmath>

namespace vbaa::antenna {

namespace {

template <int COUNT>
std::array<double, COUNT> chebyshev() {
    std::array<double, COUNT> nodes;
    for (int i = 0; i < COUNT; ++i) {
        double root = std::sin(0.5 * M_PI * i / (COUNT - 1));
        nodes[i] = root * root;
    }
    return nodes;
}

double mode(int k, double x) { return std::cos(k * std::acos(x)); }

// An antiderivative of Chebyshev's polynomial T_k.
double summed_mode(int k, double x) {
    if (k < 2) return k == 0 ? x : 0.5 * x * x;
    return mode(k + 1, x) / (2.0 * (k + 1)) - mode(k - 1, x) / (2.0 * (k - 1));
}

// From values at the nodes to the polynomial through them at a place, or to its integral from 0 to there.
//
// The polynomial's Chebyshev coefficients are discrete cosine sums over the nodes, ends by half.
template <int COUNT>
std::array<double, COUNT> weights(double at, bool integral) {
    constexpr int degree = COUNT - 1;
    std::array<double, COUNT> found = {};
    double x = 2.0 * at - 1.0;
    for (int k = 0; k < COUNT; ++k) {
        double value = integral ? 0.5 * (summed_mode(k, x) - summed_mode(k, -1.0)) : mode(k, x);
        for (int j = 0; j < COUNT; ++j) {
            double half = (k % degree ? 1.0 : 0.5) * (j % degree ? 1.0 : 0.5);
            found[j] += half * 2.0 / degree * std::cos(M_PI * k * (degree - j) / degree) * value;
        }
    }
    return found;
}

template <int COUNT>
Weights<COUNT, COUNT> integrals_from(const std::array<double, COUNT>& nodes, double start, double sign) {
    Weights<COUNT, COUNT> found;
    auto before = weights<COUNT>(start, true);
    for (int i = 0; i < COUNT; ++i) {
        found[i] = weights<COUNT>(nodes[i], true);
        for (int j = 0; j < COUNT; ++j) found[i][j] = sign * (found[i][j] - before[j]);
    }
    return found;
}

// From values at the nodes to the coefficients of powers of x from −1 to 1.
template <int COUNT>
Weights<COUNT, COUNT> powers() {
    // T_k by powers
    std::array<std::array<double, COUNT>, COUNT> modes = {};
    for (int k = 0; k < COUNT; ++k) {
        if (k < 2) {
            modes[k][k] = 1.0;
            continue;
        }
        for (int power = 0; power < COUNT; ++power)
            modes[k][power] = (power ? 2.0 * modes[k - 1][power - 1] : 0.0) - modes[k - 2][power];
    }
    constexpr int degree = COUNT - 1;
    Weights<COUNT, COUNT> found = {};
    for (int k = 0; k < COUNT; ++k) {
        for (int j = 0; j < COUNT; ++j) {
            double half = (k % degree ? 1.0 : 0.5) * (j % degree ? 1.0 : 0.5);
            double coefficient = half * 2.0 / degree * std::cos(M_PI * k * (degree - j) / degree);
            for (int power = 0; power < COUNT; ++power) found[power][j] += coefficient * modes[k][power];
        }
    }
    return found;
}

NodeTables made() {
    NodeTables tables;
    tables.panel = chebyshev<NodeTables::PANEL>();
    tables.panel_from_start = integrals_from<NodeTables::PANEL>(tables.panel, 0.0, 1.0);
    tables.panel_from_end = integrals_from<NodeTables::PANEL>(tables.panel, 1.0, -1.0);
    tables.panel_powers = powers<NodeTables::PANEL>();
    tables.inner = chebyshev<INNER_NODES>();
    tables.outer = chebyshev<OUTER_NODES>();
    tables.inner_from_contact = integrals_from<INNER_NODES>(tables.inner, 1.0, 1.0);
    tables.inner_from_tip = integrals_from<INNER_NODES>(tables.inner, 1.0, -1.0);
    tables.outer_from_contact = integrals_from<OUTER_NODES>(tables.outer, 0.0, 1.0);
    tables.outer_from_tip = integrals_from<OUTER_NODES>(tables.outer, 1.0, -1.0);
    for (int row = 0; row < NODES_TO_CONTACT; ++row) {
        tables.at_inner_curve[row] = weights<INNER_NODES>(curve_share(row), false);
        tables.to_inner_curve[row] = weights<INNER_NODES>(curve_share(row), true);
        for (int node = 0; node < INNER_NODES; ++node)
            tables.by_inner_node[node][row] = tables.at_inner_curve[row][node];
    }
    tables.by_outer_node = {};
    for (int row = 0; row < NODES_BEYOND; ++row) {
        tables.at_outer_curve[row] = weights<OUTER_NODES>(curve_share(NODES_TO_CONTACT + row), false);
        tables.to_outer_curve[row] = weights<OUTER_NODES>(curve_share(NODES_TO_CONTACT + row), true);
        for (int node = 0; node < OUTER_NODES; ++node)
            tables.by_outer_node[node][row] = tables.at_outer_curve[row][node];
    }
    return tables;
}

}  // namespace

const NodeTables& node_tables() {
    static const NodeTables tables = made();
    return tables;
}

}  // namespace vbaa::antenna
