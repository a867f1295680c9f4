#include "detect/path_refinement.hpp"

#include <algorithm>
#include <cmath>

#include "detect/selection.hpp"
#include "polyline.hpp"

namespace vbaa::detect {
namespace {

// Spacing of the columns across the path, or wider where it takes more columns than these.
constexpr double COLUMN_PX = 2.0;
constexpr int COLUMNS = 120;
// Least texture of the strip, as a part of its highest ridge.
constexpr double LEAST_REST = 1e-3;
// Columns across a path. Flanks lie `flank` px to either side of a row.
struct Columns {
    Array<double, 2> points, normals;  // (K, 2) px: their middles; along them
    Array<double, 1> along;            // (K,) px along the path
    double width_px;                   // of the antenna
    int reach, flank;                  // px
};

// Rows in the middle of an antenna.
int core(double width_px) { return 2 * static_cast<int>(0.35 * width_px) + 1; }

Columns columns_across(ConstMatrix path_px, double width_px, int reach) {
    const Array<double, 1> along = arc_lengths(path_px);
    const double length = along.size() ? along[along.size() - 1] : 0.0;
    Resampled path = resample(path_px, std::max(COLUMN_PX, length / COLUMNS));
    const int flank = static_cast<int>(std::ceil(0.5 * width_px + 1.2 + 0.5 * core(width_px)));
    Array<double, 2> normal = normals(path.points);
    return {std::move(path.points), std::move(normal), std::move(path.along), width_px, reach, flank};
}

// (K, R + 2F) the picture between its pixels along the columns, beyond its border as at the border, times `sign`.
// OpenCV's `remap` rounds places to a 32nd of a pixel: a path that moves by nothing would then see another picture.
template <class T>
Array<double, 2> sampled(Levels<T> picture, const Columns& across, double sign) {
    const int height = picture.shape[0], width = picture.shape[1], wide = across.reach + across.flank;
    const int beyond = std::min(width - 1, 1), below = std::min(height - 1, 1);
    const auto level = [&](int v, int u) { return static_cast<double>(picture(v, u, 0)); };
    Array<double, 2> strip(Unset{}, across.along.size(), 2 * wide + 1);
    for (int k = 0; k < strip.shape[0]; ++k)
        for (int r = 0; r <= 2 * wide; ++r) {
            const double u = across.points(k, 0) + (r - wide) * across.normals(k, 0);
            const double v = across.points(k, 1) + (r - wide) * across.normals(k, 1);
            const double inside_u = std::min(std::max(0.0, u), width - 1.0);
            const double inside_v = std::min(std::max(0.0, v), height - 1.0);
            const int left = std::min(static_cast<int>(inside_u), std::max(width - 2, 0));
            const int top = std::min(static_cast<int>(inside_v), std::max(height - 2, 0));
            const double right = inside_u - left, down = inside_v - top;
            const double near = level(top, left) * (1.0 - right) + level(top, left + beyond) * right;
            const double far = level(top + below, left) * (1.0 - right) + level(top + below, left + beyond) * right;
            strip(k, r) = sign * (near * (1.0 - down) + far * down);
        }
    return strip;
}

// (K, R) means of so many neighbouring columns of a strip (K, R), beyond its ends as at its ends.
Array<double, 2> mean_of_columns(ConstMatrix strip, int several) {
    const int last = strip.shape[0] - 1;
    Array<double, 2> mean(last + 1, strip.shape[1]);
    for (int k = 0; k <= last; ++k)
        for (int other = k - several / 2; other <= k + several / 2; ++other) {
            const ConstVector from = strip.row(std::clamp(other, 0, last));
            const Vector to = mean.row(k);
            for (int r = 0; r < strip.shape[1]; ++r) to[r] += from[r] / several;
        }
    return mean;
}

// (K, R) ridge height against texture: levels off at a few times what the strip shows everywhere.
Array<double, 2> clarity_of(const Array<double, 2>& ridge) {
    Array<double, 1> height(Unset{}, ridge.size());
    double highest = 0.0;
    for (int at = 0; at < ridge.size(); ++at) {
        height[at] = std::abs(ridge[at]);
        highest = std::max(highest, ridge[at]);
    }
    // where a drawn picture shows nothing at all, rounding must not look like a ridge
    const double rest = std::max(2.0 * median(height), LEAST_REST * highest) + 1e-12;
    Array<double, 2> clarity(ridge.view());
    for (double& each : clarity) {
        const double over = std::max(each, 0.0);
        each = over / (over + 3.0 * rest);
    }
    return clarity;
}

// (K,) a smooth curve through every column's best place.
Array<double, 1> smoothed(ConstMatrix clarity, const Columns& across, const std::vector<double>& scales, int pieces) {
    const int count = clarity.shape[0], last = clarity.shape[1] - 1;
    Array<double, 1> place(count), weights(count), share = across.along;
    for (int k = 0; k < count; ++k) {
        const ConstVector row = clarity.row(k);
        const int best = static_cast<int>(std::max_element(row.begin(), row.end()) - row.begin());
        place[k] = best - across.reach;
        if (best > 0 && best < last) {
            const double left = row[best - 1], right = row[best + 1], bend = left - 2.0 * row[best] + right;
            if (bend < -1e-6) place[k] += std::clamp(0.5 * (left - right) / bend, -0.5, 0.5);
            weights[k] = square(row[best]);
        }
    }
    for (double& each : share) each /= std::max(across.along[count - 1], 1e-6);
    return fit_smooth(share, place, weights, scales, pieces, 0.3).values;
}

// (K, 2) the path near a stiff curve (K,) through ridges of some clarity (K, R).
Array<double, 2> near_curve(ConstMatrix clarity, const Columns& across, ConstVector stiff) {
    const int reach = across.reach, count = stiff.shape[0];
    const double reach_near = std::max(0.6 * across.width_px, 3.0);
    Array<double, 2> nearby(count, 2 * reach + 1);
    for (int k = 0; k < count; ++k)
        for (int r = 0; r <= 2 * reach; ++r)
            if (std::abs(r - reach - stiff[k]) <= reach_near) nearby(k, r) = clarity(k, r);
    const Array<double, 1> supple = smoothed(nearby, across, {1.5, 0.7}, 16);
    Array<double, 2> path = across.points;
    for (int k = 0; k < count; ++k) {
        const double shift = std::min(std::max(-1.0 * reach, supple[k]), 1.0 * reach);
        for (int axis = 0; axis < 2; ++axis) path(k, axis) += shift * across.normals(k, axis);
    }
    return path;
}

// (K, R) by how much the middle of a line is brighter than both flanks, in a strip (K, R + 2F).
Array<double, 2> bright_ridges(ConstMatrix strip, const Columns& across) {
    const int flank = across.flank;
    Array<double, 2> ridge(Unset{}, strip.shape[0], 2 * across.reach + 1);
    Array<double, 1> level(strip.shape[1]);
    for (int k = 0; k < ridge.shape[0]; ++k) {
        running_mean(strip.row(k), core(across.width_px), Beyond::end_value, level);
        for (int r = 0; r < ridge.shape[1]; ++r)
            ridge(k, r) = level[r + flank] - std::max(level[r], level[r + 2 * flank]);
    }
    return ridge;
}

}  // namespace

Array<double, 2> refine_path(const Picture& picture, ConstMatrix path_px, double width_px, double reach_px,
                             double sign) {
    const Columns across = columns_across(path_px, width_px, static_cast<int>(std::ceil(reach_px)));
    if (across.along.size() < 2) return {};
    const auto raw = std::visit([&](auto levels) { return sampled(levels, across, sign); }, picture);
    const Array<double, 2> clarity = clarity_of(bright_ridges(mean_of_columns(raw, 3), across));
    return near_curve(clarity, across, smoothed(clarity, across, {0.7 * reach_px, 3.0, 2.0}, 6));
}

}  // namespace vbaa::detect
