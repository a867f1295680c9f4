#include "detect/crossings.hpp"

#include <algorithm>
#include <cmath>

#include "polyline.hpp"
#include "smooth.hpp"

namespace vbaa::detect {
namespace {

// Spacing of the path's points: below a pixel, so that no step passes two columns.
constexpr double SPACING_PX = 0.95;
// The path's curvature is a mean over so many of its points.
constexpr int BOW_RUN = 23;

using Pixels = View<int, 2>;
using Profiles = std::array<Array<double, 2>, 2>;

// Crossings to be filled in.
Crossings unset(int count, int length) {
    Crossings found;
    found.points = Array<double, 2>(Unset{}, count, 2);
    found.axis = Array<int, 1>(Unset{}, count);
    found.inside = Array<unsigned char, 1>(Unset{}, count);
    for (auto* each : {&found.along, &found.stretch, &found.side, &found.bow, &found.slant})
        *each = Array<double, 1>(Unset{}, count);
    const auto both = std::make_shared<const Profiles>(
        Profiles{Array<double, 2>(Unset{}, count, length), Array<double, 2>(Unset{}, count, length)});
    found.across = (*both)[0];
    found.profiles = (*both)[1];
    found.kept = both;
    return found;
}

// A writable view of a constant one, for arrays that only this file writes and that have no copies yet.
Matrix writable(ConstMatrix values) { return {const_cast<double*>(values.data), values.shape}; }

// The pixel nearest to a place, far outside of any picture for what is no number or too large.
int pixel(double place) { return static_cast<int>(std::rint(std::min(std::max(-1e9, place), 1e9))); }

// (K,) by how much the direction turns per px at each point of a path, towards its normal (K, 2).
Array<double, 1> turning(ConstMatrix normal) {
    const int last = normal.shape[0] - 1;
    Array<double, 1> found(last + 1);
    for (int k = 0; k <= last; ++k) {
        const int before = std::max(k - 1, 0), after = std::min(k + 1, last);
        const double u = normal(after, 1) - normal(before, 1), v = normal(before, 0) - normal(after, 0);
        found[k] = (u * normal(k, 0) + v * normal(k, 1)) / ((after - before) * SPACING_PX);
    }
    return found;
}

// A line of pixels that a step of the path crosses: coordinate across it, or NaN where the step crosses none.
double crossed_line(double one, double other) {
    const double line = std::ceil(std::min(one, other));
    return line < std::max(one, other) ? line : std::nan("");
}

// Fills in the profiles, from each one's first pixel (N, 2), u and v, that lie in the picture.
template <class T>
void read(Levels<T> picture, int channel, Pixels first, double sign, Crossings& found) {
    const int height = picture.shape[0], width = picture.shape[1], last = found.profiles.shape[1] - 1;
    const Matrix profiles = writable(found.profiles);
    for (int n = 0; n < first.shape[0]; ++n) {
        const int u = first(n, 0), v = first(n, 1), down = found.axis[n], right = 1 - down;
        found.inside[n] = u >= 0 && v >= 0 && u + last * right < width && v + last * down < height;
        if (!found.inside[n]) {
            std::fill_n(profiles.row(n).data, last + 1, 0.0);
            continue;
        }
        const T* from = &picture(v, u, channel);
        const std::ptrdiff_t step = picture.shape[2] * (down ? picture.shape[1] : 1);
        for (int t = 0; t <= last; ++t) profiles(n, t) = sign * static_cast<double>(from[t * step]);
    }
}

// Every so many of an array's rows.
template <class T, int N>
Array<T, N> every_row(View<const T, N> values, int step) {
    const int count = (values.shape[0] + step - 1) / step;
    const std::size_t size = values.shape[0] ? values.size() / values.shape[0] : 0;
    Array<T, N> some;
    some.shape = values.shape;
    some.shape[0] = count;
    some.values.reserve(count * size);
    for (int n = 0; n < count; ++n) {
        const T* from = values.data + n * step * size;
        some.values.insert(some.values.end(), from, from + size);
    }
    return some;
}

}  // namespace

Crossings crossings(const Picture& picture, ConstMatrix path_px, int half, double sign, int channel) {
    const auto [path, along] = resample(path_px, SPACING_PX);
    const Array<double, 2> normal = normals(path);
    const Array<double, 1> bend = running_mean(turning(normal), BOW_RUN, Beyond::end_value);
    const int steps = std::max(along.size() - 1, 0), length = 2 * half + 1;
    std::vector<double> line(steps);
    int count = 0;
    const auto upward = [&](int k) { return std::abs(normal(k, 0)) > std::abs(normal(k, 1)) ? 1 : 0; };
    for (int k = 0; k < steps; ++k) {
        line[k] = crossed_line(path(k, upward(k)), path(k + 1, upward(k)));
        count += line[k] == line[k];
    }
    Crossings found = unset(count, length);
    const Matrix across = writable(found.across);
    Array<int, 2> first(count, 2);
    for (int k = 0, n = 0; k < steps; ++k) {
        if (line[k] != line[k]) continue;
        const int crossed = upward(k), axis = 1 - crossed;
        const double part = (line[k] - path(k, crossed)) / (path(k + 1, crossed) - path(k, crossed));
        for (int i = 0; i < 2; ++i) found.points(n, i) = path(k, i) + part * (path(k + 1, i) - path(k, i));
        found.axis[n] = axis;
        found.along[n] = along[k] + SPACING_PX * part;
        found.side[n] = normal(k, axis) < 0.0 ? -1.0 : 1.0;
        found.stretch[n] = 1.0 / std::max(std::abs(normal(k, axis)), 0.5);
        const double slant = normal(k, crossed);
        found.bow[n] = -0.5 * found.side[n] * bend[k] * slant * slant;
        found.slant[n] = path(k + 1, axis) < path(k, axis) ? -std::abs(slant) : std::abs(slant);
        const double middle = std::rint(found.points(n, axis)), off = found.points(n, axis) - middle;
        for (int t = 0; t < length; ++t) across(n, t) = t - half - off;
        first(n, crossed) = pixel(line[k]);
        first(n, axis) = pixel(middle) - half;
        ++n;
    }
    std::visit([&](auto levels) { read(levels, channel, first.view(), sign, found); }, picture);
    return found;
}

Crossings every(const Crossings& found, int step) {
    Crossings some;
    some.points = every_row(found.points.view(), step);
    some.axis = every_row(found.axis.view(), step);
    some.along = every_row(found.along.view(), step);
    some.stretch = every_row(found.stretch.view(), step);
    some.side = every_row(found.side.view(), step);
    some.bow = every_row(found.bow.view(), step);
    some.slant = every_row(found.slant.view(), step);
    some.inside = every_row(found.inside.view(), step);
    const auto both =
        std::make_shared<const Profiles>(Profiles{every_row(found.across, step), every_row(found.profiles, step)});
    some.across = (*both)[0];
    some.profiles = (*both)[1];
    some.kept = both;
    return some;
}

Array<double, 1> shares(const Crossings& found) {
    Array<double, 1> share = found.along;
    for (double& each : share) each /= std::max(found.along[share.size() - 1], 1e-6);
    return share;
}

void distances(const Crossings& found, int n, double centre, Vector across) {
    const double linear = found.side[n] / found.stretch[n], square = found.side[n] * found.bow[n];
    for (int t = 0; t < across.shape[0]; ++t) {
        const double along = found.across(n, t) - centre;
        across[t] = along * (linear + square * along);
    }
}

void in_width(Crossings& found, int n, double width, double growth) {
    found.stretch[n] *= width;
    found.bow[n] /= width;
    // a spacing that doubles within a pixel is not a line's
    if (std::abs(growth) < 1.0) found.bow[n] -= growth * found.slant[n] / found.stretch[n];
}

Crossings tapered(Crossings found, const Taper& taper) {
    const Array<double, 1> share = shares(found);
    const double length = length_px(found);
    for (int n = 0; n < share.size(); ++n) {
        const double along = share[n] - 0.5;
        const double width = 1.0 + along * (taper.part + along * taper.bend) - taper.bend / 12.0;
        in_width(found, n, width, (taper.part + 2.0 * along * taper.bend) / (length * width));
    }
    return found;
}

Array<double, 2> moved(const Crossings& found, ConstVector shift) {
    Array<double, 2> points = found.points;
    for (int n = 0; n < shift.shape[0]; ++n) points(n, found.axis[n]) += shift[n];
    return points;
}

}  // namespace vbaa::detect
