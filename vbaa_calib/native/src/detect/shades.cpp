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
    Table table(2 * middle + 1, SHADE_COLUMNS);
    for (int r = 0; r <= middle; ++r) {
        const double across = static_cast<double>(r) / PER_PX;
        double* const own = table.row(middle + r).data;
        double* const mirrored = table.row(middle - r).data;
        std::array<Lanes, KINDS> sums;
        sums.fill(0.0);
        for (int q = 0; q < nodes; ++q) {
            const double off = (across - half * on.across[q]) / std;
            if (!(std::abs(off) < FAR_STD)) continue;
            const double bell = height * half * on.weight[q] * std::exp(-0.5 * off * off);
            const Lanes weighted = Lanes(bell) * load(on.shades.row(q).data);
            sums[VALUE] += weighted;
            sums[BY_DISTANCE] += Lanes(-off / std) * weighted;
            sums[BY_WIDTH] += Lanes(1.0 + half * on.across[q] * off / std) * weighted;
            sums[BY_BLUR] += Lanes((off * off - 1.0) * softer) * weighted;
        }
        for (int kind = 0; kind < KINDS; ++kind)
            for (int k = 1; k < SHADES; ++k) own[kind * LANES + shade_column(k)] = sums[kind][k];
        const double left = (across + half) / std, right = (across - half) / std;
        const double rising = height * std::exp(-0.5 * left * left), falling = height * std::exp(-0.5 * right * right);
        const double inside_left = 0.5 * std::erfc(-left / std::sqrt(2.0));
        const double beyond_right = 0.5 * std::erfc(-right / std::sqrt(2.0));
        const std::array<double, KINDS> on_left = {1.0 - inside_left, -rising, -half * rising,
                                                   left * rising * std * softer};
        const std::array<double, KINDS> on_right = {beyond_right, falling, -half * falling,
                                                    -right * falling * std * softer};
        for (int kind = 0; kind < KINDS; ++kind) {
            double* const to = own + kind * LANES;
            to[0] = on_left[kind];
            to[1] = on_right[kind];
            // what is beyond the middle is the mirror of what is before it
            const double sign = kind == BY_DISTANCE ? -1.0 : 1.0;
            double* const other = mirrored + kind * LANES;
            other[0] = sign * on_right[kind];
            other[1] = sign * on_left[kind];
            for (int k = 1; k < SHADES; ++k) other[shade_column(k)] = (k % 2 ? -sign : sign) * to[shade_column(k)];
        }
    }
    return table;
}

}  // namespace vbaa::detect
