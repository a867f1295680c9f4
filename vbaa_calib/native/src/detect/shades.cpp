// Tables of shades by quadrature over the surface's angle.
#include "detect/shades.hpp"

#include <cmath>

#include "lanes.hpp"

namespace vbaa::detect {
namespace {

constexpr double FAR_STD = 6.0;        // deviations of the blur beyond which nothing of it is left
constexpr double NODES_PER_STD = 5.0;  // places on the surface per deviation of the blur, where it is seen head on
constexpr int LEAST_NODES = 16, MOST_NODES = 400;

// Places on the surface: across the silhouette, in its half widths, their weights there, and (Q, LANES) the shades.
struct Surface {
    Numbers across, weight;
    Table shades;
};

Surface surface(int nodes) {
    Surface found = {Numbers(nodes), Numbers(nodes), Table(nodes, LANES)};
    double whole = 0.0;
    std::array<double, SHADES> mean = {}, power = {};
    for (int q = 0; q < nodes; ++q) {
        const double angle = M_PI * ((q + 0.5) / nodes - 0.5);
        found.across[q] = std::sin(angle);
        found.weight[q] = std::cos(angle) * M_PI / nodes;
        whole += found.weight[q];
        found.shades(q, 0) = 1.0;
        for (int k = 1; k <= HARMONICS; ++k) {
            found.shades(q, 2 * k - 1) = std::sin(k * angle);
            found.shades(q, 2 * k) = std::cos(k * angle);
        }
        for (int k = 0; k < SHADES; ++k) mean[k] += found.weight[q] * found.shades(q, k);
    }
    for (int q = 0; q < nodes; ++q)
        for (int k = 1; k < SHADES; ++k) {
            found.shades(q, k) -= mean[k] / whole;
            power[k] += found.weight[q] * square(found.shades(q, k));
        }
    for (int q = 0; q < nodes; ++q)
        for (int k = 1; k < SHADES; ++k) found.shades(q, k) /= std::sqrt(power[k] / whole);
    return found;
}

}  // namespace

Table shade_table(double width_px, double blur_px, int reach_px) {
    const double half = 0.5 * width_px, std = std::hypot(blur_px, PIXEL_BLUR_PX), softer = square(blur_px / std);
    const double height = 1.0 / (std::sqrt(2.0 * M_PI) * std);
    const int nodes = static_cast<int>(bounded(NODES_PER_STD * half / std, LEAST_NODES, MOST_NODES));
    const Surface on = surface(nodes);
    const int middle = reach_px * PER_PX;
    Table table(Unset{}, 2 * middle + 1, SHADE_COLUMNS);
    const double softening = std * softer;
    const auto bell_at = [&](const Lanes& off) { return Lanes(height) * exp(Lanes(-0.5) * off * off); };
    for (int first = 0; first <= middle; first += LANES) {
        Lanes across;
        for (int lane = 0; lane < LANES; ++lane) across[lane] = static_cast<double>(first + lane) / PER_PX;
        std::array<std::array<Lanes, LANES>, KINDS> values;  // of each function, on the right of the middle
        for (auto& kind : values) kind.fill(0.0);
        for (int q = 0; q < nodes; ++q) {
            const double on_surface = half * on.across[q];
            const Lanes off = (across - Lanes(on_surface)) * Lanes(1.0 / std);
            if (off[0] > FAR_STD || off[LANES - 1] < -FAR_STD) continue;
            const Lanes bell = bell_at(off) * Lanes(half * on.weight[q]);
            const std::array<Lanes, KINDS> weighted = {bell, bell * off * Lanes(-1.0 / std),
                                                       bell * (Lanes(1.0) + off * Lanes(on_surface / std)),
                                                       bell * (off * off - Lanes(1.0)) * Lanes(softer)};
#pragma GCC unroll 8
            for (int k = 1; k < SHADES; ++k) {
                const Lanes shade = on.shades(q, k);
#pragma GCC unroll 4
                for (int kind = 0; kind < KINDS; ++kind) values[kind][shade_column(k)] += shade * weighted[kind];
            }
        }
        const Lanes left = (across + Lanes(half)) * Lanes(1.0 / std), right = (across - Lanes(half)) * Lanes(1.0 / std);
        const Lanes rising = bell_at(left), falling = bell_at(right);
        const auto beyond = [](double off) { return 0.5 * std::erfc(off / std::sqrt(2.0)); };
        const std::array<Lanes, KINDS> on_left = {left.mapped(beyond), -rising, Lanes(-half) * rising,
                                                  left * rising * Lanes(softening)};
        const std::array<Lanes, KINDS> on_right = {(-right).mapped(beyond), falling, Lanes(-half) * falling,
                                                   -right * falling * Lanes(softening)};
        for (int kind = 0; kind < KINDS; ++kind) {
            auto& of = values[kind];
            of[0] = on_left[kind], of[1] = on_right[kind];
            // what is beyond the middle is the mirror of what is before it
            const double sign = kind == BY_DISTANCE ? -1.0 : 1.0;
            Lanes rows[LANES], mirrored[LANES] = {Lanes(sign) * of[1], Lanes(sign) * of[0]};
            for (int k = 1; k < SHADES; ++k)
                mirrored[shade_column(k)] = Lanes(k % 2 ? -sign : sign) * of[shade_column(k)];
            std::copy(of.begin(), of.end(), rows);
            transpose(rows), transpose(mirrored);
            for (int lane = 0; lane < LANES && first + lane <= middle; ++lane) {
                store(table.row(middle + first + lane).data + kind * LANES, rows[lane]);
                store(table.row(middle - first - lane).data + kind * LANES, mirrored[lane]);
            }
        }
    }
    return table;
}

}  // namespace vbaa::detect
