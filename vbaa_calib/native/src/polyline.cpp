#include "polyline.hpp"

#include <algorithm>
#include <cmath>

namespace vbaa {
namespace {

// Difference up to which a number of spacings counts as whole.
constexpr double WHOLE = 1e-6;
// Largest number of points of a path.
constexpr double MOST = 1e6;

double length(double u, double v) { return std::sqrt(u * u + v * v); }

}  // namespace

Array<double, 1> arc_lengths(ConstMatrix polyline) {
    Array<double, 1> along(polyline.shape[0]);
    for (int k = 1; k < along.size(); ++k)
        along[k] = along[k - 1] + length(polyline(k, 0) - polyline(k - 1, 0), polyline(k, 1) - polyline(k - 1, 1));
    return along;
}

Resampled resample(ConstMatrix polyline, double spacing) {
    const Array<double, 1> along = arc_lengths(polyline);
    const int last = along.size() - 1;
    // for a spacing that divides the length, rounding must not decide whether the end is one of the points
    const double spacings = last < 1 ? 0.0 : std::ceil(along[last] / spacing - WHOLE);
    const int count = spacings > 0.0 && spacings < MOST ? static_cast<int>(spacings) : 0;
    Resampled found{Array<double, 2>(count, 2), Array<double, 1>(count)};
    for (int n = 0, k = 0; n < count; ++n) {
        const double at = found.along[n] = spacing * n;
        while (k < last - 1 && along[k + 1] <= at) ++k;
        const double part = (at - along[k]) / (along[k + 1] - along[k]);
        for (int axis = 0; axis < 2; ++axis)
            found.points(n, axis) = polyline(k, axis) + part * (polyline(k + 1, axis) - polyline(k, axis));
    }
    return found;
}

Array<double, 2> normals(ConstMatrix polyline) {
    const int last = polyline.shape[0] - 1;
    Array<double, 2> normal(last + 1, 2);
    for (int k = 0; k <= last && last > 0; ++k) {
        const int before = std::max(k - 1, 0), after = std::min(k + 1, last);
        const double u = polyline(after, 0) - polyline(before, 0), v = polyline(after, 1) - polyline(before, 1);
        const double size = length(u, v);
        normal(k, 0) = -v / size;
        normal(k, 1) = u / size;
    }
    return normal;
}

Nearest nearest_on(ConstMatrix polyline, ConstMatrix points) {
    const int count = polyline.shape[0], several = points.shape[0];
    const Array<double, 2> normal = normals(polyline);
    const Array<double, 1> along = arc_lengths(polyline);
    double step = 1e-12;
    for (int k = 1; k < count; ++k) step = std::max(step, along[k] - along[k - 1]);
    Nearest found{Array<std::int64_t, 1>(several), Array<double, 1>(several)};
    int best = 0;  // the nearest of the point before begins well
    for (int n = 0; n < several; ++n) {
        const double u = points(n, 0), v = points(n, 1);
        double least = length(polyline(best, 0) - u, polyline(best, 1) - v);
        for (int k = 0; k < count;) {
            const double here = length(polyline(k, 0) - u, polyline(k, 1) - v);
            if (here < least) best = k, least = here;
            // number of further points that cannot be nearer
            const double skipped = std::min((here - least) / step, static_cast<double>(count));
            k += skipped > 1.0 ? static_cast<int>(skipped) : 1;
        }
        found.index[n] = best;
        found.distance[n] = (u - polyline(best, 0)) * normal(best, 0) + (v - polyline(best, 1)) * normal(best, 1);
    }
    return found;
}

Feet feet_on(ConstMatrix nodes, ConstMatrix slopes, ConstVector arclength, ConstMatrix points) {
    constexpr int STEPS = 4;  // of Newton's
    const int pieces = nodes.shape[0] - 1, count = points.shape[0];
    Array<double, 2> coefficients(pieces, 8);  // four of u by the share of a piece, then of v
    for (int k = 0; k < pieces; ++k) {
        const double width = arclength[k + 1] - arclength[k];
        for (int axis = 0; axis < 2; ++axis) {
            double* own = &coefficients(k, 4 * axis);
            const double rise = nodes(k + 1, axis) - nodes(k, axis);
            own[0] = nodes(k, axis);
            own[1] = slopes(k, axis) * width;
            own[2] = 3.0 * rise - 2.0 * own[1] - slopes(k + 1, axis) * width;
            own[3] = rise - own[1] - own[2];
        }
    }
    struct Place {
        double at[2], slope[2];
    };
    const auto place = [&](int k, double share) {
        Place found;
        for (int axis = 0; axis < 2; ++axis) {
            const double* own = &coefficients(k, 4 * axis);
            found.at[axis] = own[0] + share * (own[1] + share * (own[2] + share * own[3]));
            found.slope[axis] = own[1] + share * (2.0 * own[2] + 3.0 * share * own[3]);
        }
        return found;
    };
    Feet feet{Array<double, 1>(count), Array<double, 1>(count), Array<double, 2>(count, 2)};
    for (int n = 0; n < count; ++n) {
        const double u = points(n, 0), v = points(n, 1);
        int piece = 0;
        double least = INFINITE, share = 0.5;
        for (int k = 0; k < pieces; ++k) {
            const Place middle = place(k, 0.5);
            const double apart = length(u - middle.at[0], v - middle.at[1]);
            if (apart < least) piece = k, least = apart;
        }
        for (int step = 0; step < STEPS; ++step) {
            // a foot beyond the piece's end belongs to its neighbour, at the same place
            const int first = std::clamp(piece + static_cast<int>(std::floor(share)), 0, pieces - 1);
            share += piece - first;
            piece = first;
            const auto [at, slope] = place(piece, share);
            const double square = slope[0] * slope[0] + slope[1] * slope[1];
            share += ((u - at[0]) * slope[0] + (v - at[1]) * slope[1]) / std::max(square, 1e-30);
            // beyond the ends the curve goes on straight: points there hardly constrain the shape
            share = std::clamp(share, -1.0 - (piece > 0), 2.0 + (piece < pieces - 1));
        }
        const double inside = std::clamp(share, 0.0, 1.0);
        const auto [at, slope] = place(piece, inside);
        const double size = std::max(length(slope[0], slope[1]), 1e-30);
        feet.place[n] = piece + inside;
        feet.normal(n, 0) = -slope[1] / size;
        feet.normal(n, 1) = slope[0] / size;
        feet.distance[n] = (u - at[0]) * feet.normal(n, 0) + (v - at[1]) * feet.normal(n, 1);
    }
    return feet;
}

}  // namespace vbaa
