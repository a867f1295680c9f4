#include "taper.hpp"

#include <algorithm>
#include <cmath>

namespace vbaa::antenna {

namespace {

template <std::size_t COUNT>
using Values = std::array<double, COUNT>;

double node_of(const Panel& panel, int j) { return panel.start + (panel.end - panel.start) * node_tables().panel[j]; }

// Powers of x from −1 to 1 on a panel, of the integral from its start of the polynomial through its nodes' values.
Values<NodeTables::PANEL + 1> integrated_series(const Panel& panel, const Values<NodeTables::PANEL>& values,
                                                double start) {
    Values<NodeTables::PANEL + 1> found = {};
    const double half = 0.5 * (panel.end - panel.start);
    for (int power = 0; power < NodeTables::PANEL; ++power) {
        double coefficient = 0.0;
        for (int j = 0; j < NodeTables::PANEL; ++j) coefficient += node_tables().panel_powers[power][j] * values[j];
        found[power + 1] = half * coefficient / (power + 1);
    }
    found[0] = start;
    for (int power = 1; power <= NodeTables::PANEL; ++power) found[0] -= (power % 2 ? -1.0 : 1.0) * found[power];
    return found;
}

// The integral from a panel's node to its end.
Values<NodeTables::PANEL> to_end(const Panel& panel, const Values<NodeTables::PANEL>& values, double at_end) {
    Values<NodeTables::PANEL> found;
    for (int i = 0; i < NodeTables::PANEL; ++i) {
        found[i] = at_end;
        for (int j = 0; j < NodeTables::PANEL; ++j)
            found[i] += (panel.end - panel.start) * node_tables().panel_from_end[i][j] * values[j];
    }
    return found;
}

void add_panels(const double* piece, Taper& taper) {
    // largest ratio of the diameters at a panel's ends, and a panel's largest length
    constexpr double MOST_RATIO = 1.7, LONGEST = 0.5;
    const double start = piece[0], end = piece[1];
    const int power = static_cast<int>(piece[6]);
    const double ratio = std::max(piece[4] / piece[5], piece[5] / piece[4]);
    const double largest = power == 1 ? MOST_RATIO * MOST_RATIO : MOST_RATIO;
    const int parts = static_cast<int>(
        std::ceil(std::max({std::log(ratio) / std::log(largest) - 1e-9, (end - start) / LONGEST - 1e-9, 1.0})));
    const double diameter_slope = (piece[3] - piece[2]) / (end - start),
                 root_slope = (piece[5] - piece[4]) / (end - start);
    double from = start;
    for (int k = 1; k <= parts && taper.count < Taper::PANELS; ++k) {
        double to = end;
        if (k < parts) {
            // equal ratios of the root, equal lengths where it hardly changes
            const double share = static_cast<double>(k) / parts;
            const double grown = std::abs(ratio - 1.0) < 0.3
                                     ? share
                                     : (std::pow(piece[5] / piece[4], share) - 1.0) / (piece[5] / piece[4] - 1.0);
            to = start + grown * (end - start);
        }
        taper.panels[taper.count++] = {from,
                                       to,
                                       piece[2] + diameter_slope * (from - start),
                                       diameter_slope,
                                       piece[4] + root_slope * (from - start),
                                       root_slope,
                                       power};
        from = to;
    }
    taper.panels[taper.count - 1].end = end;
}

}  // namespace

bool sound_taper(ConstMatrix pieces) {
    const int count = pieces.shape[0];
    if (count == 0) return true;
    if (count > Taper::PIECES || pieces.shape[1] != 7) return false;
    for (int k = 0; k < count; ++k) {
        const double* piece = pieces.row(k).data;
        if (!(piece[0] < piece[1])) return false;
        if (piece[0] != (k ? pieces(k - 1, 1) : 0.0)) return false;
        for (int column = 2; column < 6; ++column)
            if (!(piece[column] >= 1e-4 && piece[column] <= 1e4)) return false;
        if (piece[6] != 1.0 && piece[6] != 4.0) return false;
    }
    return pieces(count - 1, 1) == 1.0;
}

Taper taper_of(ConstMatrix pieces) {
    Taper taper;
    for (int k = 0; k < pieces.shape[0]; ++k) add_panels(pieces.row(k).data, taper);
    // from the tip: the weight beyond each node, and its moment
    std::array<Values<NodeTables::PANEL>, Taper::PANELS> moments;
    double beyond = 0.0, moment = 0.0;
    for (int k = taper.count - 1; k >= 0; --k) {
        const Panel& panel = taper.panels[k];
        Values<NodeTables::PANEL> weights;
        for (int j = 0; j < NodeTables::PANEL; ++j) weights[j] = weight_at(panel, node_of(panel, j));
        const Values<NodeTables::PANEL> heavy = to_end(panel, weights, beyond);
        moments[k] = to_end(panel, heavy, moment);
        beyond = heavy[0];
        moment = moments[k][0];
    }
    if (taper) {
        taper.weight = beyond;
        taper.weight_moment = moment;
    }
    Integrals start = {};
    constexpr double Integrals::* FIELDS[] = {&Integrals::c, &Integrals::cx, &Integrals::cxx, &Integrals::weighed,
                                              &Integrals::weighed_x};
    for (int k = 0; k < taper.count; ++k) {
        const Panel& panel = taper.panels[k];
        for (int field = 0; field < 5; ++field) {
            Values<NodeTables::PANEL> values;
            for (int j = 0; j < NodeTables::PANEL; ++j) {
                const double x = node_of(panel, j), c = flexibility(panel, x);
                const double factors[] = {1.0, x, x * x, moments[k][j], x * moments[k][j]};
                values[j] = c * factors[field];
            }
            const auto series = integrated_series(panel, values, start.*FIELDS[field]);
            double at_end = 0.0;
            for (int power = 0; power <= NodeTables::PANEL; ++power) {
                taper.series[k][power].*FIELDS[field] = series[power];
                at_end += series[power];
            }
            start.*FIELDS[field] = at_end;
        }
    }
    return taper;
}

namespace {

int panel_at(const Taper& taper, double place) {
    int k = 0;
    while (k < taper.count - 1 && place >= taper.panels[k].end) ++k;
    return k;
}

}  // namespace

Integrals integrals_at(const Taper& taper, double place) {
    const int k = panel_at(taper, place);
    const Panel& panel = taper.panels[k];
    const double x = (2.0 * place - panel.start - panel.end) / (panel.end - panel.start);
    Integrals found = taper.series[k][NodeTables::PANEL];
    for (int power = NodeTables::PANEL - 1; power >= 0; --power) {
        const Integrals& next = taper.series[k][power];
        found = {found.c * x + next.c, found.cx * x + next.cx, found.cxx * x + next.cxx,
                 found.weighed * x + next.weighed, found.weighed_x * x + next.weighed_x};
    }
    return found;
}

double weight_at(const Taper& taper, double place) {
    return taper ? weight_at(taper.panels[panel_at(taper, place)], place) : 1.0;
}

}  // namespace vbaa::antenna
