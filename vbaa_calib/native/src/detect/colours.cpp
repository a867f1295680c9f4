#include "detect/colours.hpp"

#include <algorithm>
#include <cmath>

#include "detect/selection.hpp"

namespace vbaa::detect {
namespace {

// The fewest points from which the brightness of the light is estimated.
constexpr int LEAST_POINTS = 20;
// SHADE: limits of a shadowed antenna's brightness over that in the light. TINT: the quantile of its hue's error in the
// light, and the multiple of that which is allowed in a shadow.
constexpr double SHADE[2] = {0.33, 1.15}, TINT[2] = {0.9, 2.0};
// ROOT: share of the line, from the clamp, from which its lighting is estimated. LIGHT: limits of that factor.
constexpr double ROOT = 0.4, LIGHT[2] = {0.6, 1.7};

int nearest_pixel(double place, int size) {
    return static_cast<int>(std::rint(std::min(std::max(0.0, place), size - 1.0)));
}

// (4, N) the looks (PLACES, 4) at shares (N,) of the way: three channels and the deviation.
Array<double, 2> usual_looks(ConstMatrix looks, ConstVector shares) {
    const int places = looks.shape[0];
    Array<double, 1> at(places), each(places);
    Array<double, 2> usual(4, shares.shape[0]);
    for (int c = 0; c < 4; ++c) {
        for (int p = 0; p < places; ++p) at[p] = (p + 0.5) / places, each[p] = looks(p, c);
        for (int n = 0; n < shares.shape[0]; ++n) usual(c, n) = interpolated(at, each, shares[n]);
    }
    return usual;
}

// How brightly the line is lit near its clamp, over usual: colours (N, 3) and usual looks (4, N) at shares (N,).
double light_of_line(ConstMatrix colours, ConstMatrix usual, ConstVector shares) {
    Numbers root;
    for (int n = 0; n < shares.shape[0]; ++n) {
        if (!(shares[n] < ROOT)) continue;
        double across = 0.0, own = 1e-9;
        for (int c = 0; c < 3; ++c) across += colours(n, c) * usual(c, n), own += square(usual(c, n));
        root.values.push_back(across / own);
    }
    root.shape[0] = static_cast<int>(root.values.size());
    if (root.size() < LEAST_POINTS) return 1.0;
    return std::min(std::max(central(std::move(root)), LIGHT[0]), LIGHT[1]);
}

}  // namespace

Array<double, 2> colours_at(const Picture& picture, double level, ConstMatrix points) {
    Array<double, 2> found(points.shape[0], 3);
    std::visit(
        [&](auto levels) {
            const int last = levels.shape[2] - 1;
            for (int n = 0; n < points.shape[0]; ++n) {
                const int column = nearest_pixel(points(n, 0), levels.shape[1]);
                const int row = nearest_pixel(points(n, 1), levels.shape[0]);
                for (int c = 0; c < 3; ++c) found(n, c) = levels(row, column, std::min(c, last)) / level;
            }
        },
        picture);
    return found;
}

Foreign foreign(const Picture& picture, double level, ConstMatrix points, ConstVector shares, ConstMatrix looks) {
    const int count = points.shape[0];
    const Array<double, 2> colours = colours_at(picture, level, points), usual = usual_looks(looks, shares);
    const double light = light_of_line(colours, usual, shares);
    Foreign found;
    found.other = found.tinted = Array<unsigned char, 1>(count);
    found.off = found.hue = Array<double, 1>(count);
    Array<double, 2> means(3, count);
    Array<double, 1> values(count), mean(count), lit(count), squares(count), tint(count);
    for (int c = 0; c < 3; ++c) {
        for (int n = 0; n < count; ++n) values[n] = colours(n, c) - light * usual(c, n);
        running_mean(values, RUN, Beyond::end_value, mean);
        for (int n = 0; n < count; ++n) found.off[n] += square(mean[n]), values[n] = colours(n, c);
        running_mean(values, RUN, Beyond::end_value, means.row(c));
        for (int n = 0; n < count; ++n) lit[n] += means(c, n) * usual(c, n), squares[n] += square(usual(c, n));
    }
    std::vector<double> alike;
    for (int n = 0; n < count; ++n) {
        found.off[n] = std::sqrt(found.off[n]) / (light * usual(3, n));
        const double size = std::max(squares[n], 1e-9);
        const double local = std::min(std::max(lit[n] / size, SHADE[0] * light), SHADE[1] * light);
        for (int c = 0; c < 3; ++c) found.hue[n] += square(means(c, n) - local * usual(c, n));
        // noise weighs more where it is darker
        tint[n] = std::sqrt(found.hue[n] / (size * local * light));
        found.hue[n] = std::sqrt(found.hue[n]) / (local * usual(3, n));
        if (found.off[n] < MOSTLY_FOREIGN) alike.push_back(tint[n]);
    }
    const int known = static_cast<int>(alike.size());
    const double most = known > LEAST_POINTS ? TINT[1] * quantile({alike.data(), {known}}, TINT[0]) : -1.0;
    const bool whole = central(found.off) > MOSTLY_FOREIGN;
    for (int n = 0; n < count; ++n) {
        found.tinted[n] = tint[n] > most;
        found.other[n] |= whole;
        // a run's mean blends what lies before and after its middle
        if (found.off[n] > FOREIGN)
            std::fill(found.other.begin() + std::max(n - RUN / 2, 0),
                      found.other.begin() + std::min(n + RUN / 2 + 1, count), static_cast<unsigned char>(1));
    }
    return found;
}

}  // namespace vbaa::detect
