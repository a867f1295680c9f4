#include "detect/path_refinement.hpp"

#include <algorithm>
#include <cmath>

#include "polyline.hpp"
#include "smooth.hpp"

namespace vbaa::detect {
namespace {

// Spacing of the columns across the path, or wider where it takes more columns than these.
constexpr double COLUMN_PX = 2.0;
constexpr int COLUMNS = 120;
// Least texture of the strip, as a part of its highest ridge.
constexpr double LEAST_REST = 1e-3;
// Where it is known how bright the antenna is: what a ridge of another brightness counts, deviations at which the
// brightness counts a quarter, and what a ridge counts over what is as bright as the antenna between other things.
constexpr double LEAST_ALIKE = 0.1, ALIKE = 2.0, RIDGE_PART = 0.5;
// A branch lies more than a width and so many px off the clearest curve.
constexpr double BRANCH_PX = 2.0;
// Where the polarity changes: columns that are averaged, the part of the square of an edge's height that is no line's,
// and the rows of which only the highest counts.
constexpr int FAINT_COLUMNS = 7, PEAK_ROWS = 7;
constexpr double EDGE_COST = 0.3;

// What a bent curve must show more.
constexpr double BENT_COST = 0.3;
// After so many points each, a curve is abandoned that the rest cannot make the clearest.
constexpr int GIVEN_UP = 12;
// Another curve is followed, too, if it is this part as clear and far off the clearest in so many of the points after
// the first ones.
constexpr double BRANCH_SHARE = 0.7;
constexpr int BRANCH_AFTER = 20, BRANCH_POINTS = 8;

// Columns across a path. Flanks lie `flank` px to either side of a row.
struct Columns {
    Array<double, 2> points, normals;  // (K, 2) px: their middles; along them
    Array<double, 1> along;            // (K,) px along the path
    double width_px;                   // of the antenna
    int reach, flank;                  // px
};

double square(double value) { return value * value; }

// A row of so many to either side of the middle one; what is no number lies on the first.
int row_at(double px, int reach) {
    return static_cast<int>(std::rint(std::min(std::max(0.0, px + reach), 2.0 * reach)));
}

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
    Array<double, 2> strip(across.along.size(), 2 * wide + 1);
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
    Array<double, 1> height(ridge.size());
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

// (K, R) the highest of so many neighbours in each column of values (K, R).
Array<double, 2> highest_nearby(ConstMatrix values, int rows) {
    const int columns = values.shape[0], last = values.shape[1] - 1, half = rows / 2;
    Array<double, 2> highest(values);
    for (int k = 0; k < columns; ++k)
        for (int off = 1; off <= half; ++off) {
            for (int r = off; r <= last; ++r) highest(k, r) = std::max(highest(k, r), values(k, r - off));
            for (int r = 0; r <= last - off; ++r) highest(k, r) = std::max(highest(k, r), values(k, r + off));
        }
    return highest;
}

struct Clearest {
    int curve = -1;
    double clear = -std::numeric_limits<double>::infinity();
};

// Whether a curve is elsewhere than another.
bool leaves(const Curves& tried, int curve, int other, double apart_px) {
    int far = 0;
    for (int i = BRANCH_AFTER; i < CURVE_POINTS; ++i)
        far += std::abs(tried.rows(curve, i) - tried.rows(other, i)) > apart_px;
    return far >= BRANCH_POINTS;
}

// The clearest curve of a strip (CURVE_POINTS, R) that is clearer than `found` and leaves its curve, if it is of one.
// rest : (CURVE_POINTS + 1,) what the strip's points from each one on can add.
Clearest clearest(ConstMatrix strip, const Curves& tried, double cost, ConstVector rest, Clearest known,
                  double apart_px) {
    Clearest found{-1, known.clear};
    for (int c = 0; c < tried.rows.shape[0]; ++c) {
        if (known.curve >= 0 && !leaves(tried, c, known.curve, apart_px)) continue;
        double total = -cost * tried.bent[c];
        for (int start = 0; start < CURVE_POINTS; start += GIVEN_UP) {
            if (total + rest[start] * (1.0 + 1e-9) < found.clear) break;
            for (int i = start; i < start + GIVEN_UP; ++i) total += strip(i, tried.rows(c, i));
        }
        if (total > found.clear) found = {c, total};
    }
    return found;
}

// (CURVE_POINTS,) the clearest curve of a strip (CURVE_POINTS, R) near one of those that were tried.
Array<double, 1> finer(ConstMatrix strip, const Curves& tried, int curve) {
    int finest = 0;
    double most = -std::numeric_limits<double>::infinity();
    for (int f = 0; f < tried.finer.shape[0]; ++f) {
        double total = 0.0;
        for (int i = 0; i < CURVE_POINTS; ++i) {
            total += strip(i, row_at(tried.curves(curve, i) + tried.finer(f, i), tried.reach));
        }
        if (total > most) finest = f, most = total;
    }
    Array<double, 1> best(tried.curves.row(curve));
    for (int i = 0; i < CURVE_POINTS; ++i) best[i] += tried.finer(finest, i);
    return best;
}

// (K,) rows of the clearest of the curves in a strip of some clarity (K, R), px from its middle, and of the clearest
// that goes elsewhere, (0,) where none is nearly as clear. Where the antenna is faint no column's best place is to be
// trusted: only their sum along the antenna is.
struct ClearestCurves {
    Array<double, 1> best, other;
};

ClearestCurves clearest_curves(ConstMatrix clarity, const Curves& tried, double apart_px) {
    const int count = clarity.shape[0];
    Array<double, 1> columns(CURVE_POINTS), rest(CURVE_POINTS + 1);
    Array<double, 2> few(CURVE_POINTS, clarity.shape[1]);
    for (int i = 0; i < CURVE_POINTS; ++i) {
        columns[i] = i * ((count - 1.0) / (CURVE_POINTS - 1));
        copy(clarity.row(static_cast<int>(std::rint(columns[i]))), few.row(i));
    }
    const Array<double, 2> thick = highest_nearby(few, static_cast<int>(CURVE_STEP_PX) + 1);
    for (int i = CURVE_POINTS - 1; i >= 0; --i) {
        const ConstVector row = thick.row(i);
        rest[i] = rest[i + 1] + *std::max_element(row.begin(), row.end());
    }
    const double cost = BENT_COST * *std::max_element(thick.begin(), thick.end()) * CURVE_POINTS;
    const Clearest best = clearest(thick, tried, cost, rest, {}, 0.0);
    const Clearest other = clearest(thick, tried, cost, rest, {best.curve, BRANCH_SHARE * best.clear}, apart_px);
    const auto along = [&](int curve) {
        if (curve < 0) return Array<double, 1>(0);
        const Array<double, 1> found = finer(few, tried, curve);
        Array<double, 1> each(count);
        for (int k = 0; k < count; ++k) each[k] = interpolated(columns, found, k);
        return each;
    };
    return {along(std::max(best.curve, 0)), along(best.curve < 0 ? -1 : other.curve)};
}

// (K,) a smooth curve through every column's best place, and the clarity of a typical one.
struct Smoothed {
    Array<double, 1> curve;
    double clarity;
};

Smoothed smoothed(ConstMatrix clarity, const Columns& across, const std::vector<double>& scales, int pieces) {
    const int count = clarity.shape[0], last = clarity.shape[1] - 1;
    Array<double, 1> place(count), weights(count), peak(count), share = across.along;
    for (int k = 0; k < count; ++k) {
        const ConstVector row = clarity.row(k);
        const int best = static_cast<int>(std::max_element(row.begin(), row.end()) - row.begin());
        place[k] = best - across.reach;
        peak[k] = row[best];
        if (best > 0 && best < last) {
            const double left = row[best - 1], right = row[best + 1], bend = left - 2.0 * row[best] + right;
            if (bend < -1e-6) place[k] += std::clamp(0.5 * (left - right) / bend, -0.5, 0.5);
            weights[k] = square(peak[k]);
        }
    }
    for (double& each : share) each /= std::max(across.along[count - 1], 1e-6);
    return {fit_smooth(share, place, weights, scales, pieces, 0.3).values, quantile(peak, 0.75)};
}

// The path near a stiff curve (K,) through ridges (K, R) of some clarity (K, R), `scale` where it is clear.
RefinedPath near_curve(ConstMatrix ridge, ConstMatrix clarity, const Columns& across, ConstVector stiff, double scale) {
    const int reach = across.reach, count = stiff.shape[0];
    const double reach_near = std::max(0.6 * across.width_px, 3.0);
    Array<double, 2> nearby(count, 2 * reach + 1);
    for (int k = 0; k < count; ++k)
        for (int r = 0; r <= 2 * reach; ++r)
            if (std::abs(r - reach - stiff[k]) <= reach_near) nearby(k, r) = clarity(k, r);
    const Array<double, 1> supple = smoothed(nearby, across, {1.5, 0.7}, 16).curve;
    RefinedPath found;
    found.path_px = across.points;
    std::vector<double> height;
    for (int k = 0; k < count; ++k) {
        const double shift = std::min(std::max(-1.0 * reach, supple[k]), 1.0 * reach);
        const int at = row_at(shift, reach);
        if (clarity(k, at) > 0.5 * scale) height.push_back(ridge(k, at));
        for (int axis = 0; axis < 2; ++axis) found.path_px(k, axis) += shift * across.normals(k, axis);
    }
    found.share = static_cast<double>(height.size()) / count;
    if (!height.empty()) found.strength = median({height.data(), {static_cast<int>(height.size())}});
    return found;
}

// (K, R) by how much the middle of a line is brighter than both flanks, in a strip (K, R + 2F).
Array<double, 2> bright_ridges(ConstMatrix strip, const Columns& across) {
    const int flank = across.flank;
    Array<double, 2> ridge(strip.shape[0], 2 * across.reach + 1);
    Array<double, 1> level(strip.shape[1]);
    for (int k = 0; k < ridge.shape[0]; ++k) {
        running_mean(strip.row(k), core(across.width_px), Beyond::end_value, level);
        for (int r = 0; r < ridge.shape[1]; ++r)
            ridge(k, r) = level[r + flank] - std::max(level[r], level[r + 2 * flank]);
    }
    return ridge;
}

// (K, R) the root mean square difference from the flanks within a width, in a strip (K, R + 2F): less by how much the
// flanks differ from each other, as they do at an edge.
Array<double, 2> changing_ridges(ConstMatrix strip, const Columns& across) {
    const int flank = across.flank, body = 2 * static_cast<int>(0.5 * across.width_px) + 1, wide = strip.shape[1];
    Array<double, 2> ridge(strip.shape[0], 2 * across.reach + 1);
    Array<double, 1> squares(wide), middle(wide), level(wide), power(wide);
    for (int k = 0; k < ridge.shape[0]; ++k) {
        const ConstVector own = strip.row(k);
        for (int r = 0; r < wide; ++r) squares[r] = square(own[r]);
        running_mean(own, core(across.width_px), Beyond::end_value, middle);
        running_mean(own, body, Beyond::end_value, level);
        running_mean(squares, body, Beyond::end_value, power);
        for (int r = 0; r < ridge.shape[1]; ++r) {
            const double one = middle[r], other = middle[r + 2 * flank], between = 0.5 * (one + other);
            const double over =
                power[r + flank] - 2.0 * between * level[r + flank] + square(between) - EDGE_COST * square(one - other);
            ridge(k, r) = std::sqrt(std::max(over, 0.0));
        }
    }
    return ridge;
}

// How clearly the antenna shows in a strip (K, R + 2F) whose ridges have a clarity (K, R), which is replaced: as bright
// as its levels (L, 2), between flanks that are not; or else a ridge.
void as_bright(ConstMatrix strip, const Columns& across, ConstMatrix levels, Matrix clarity) {
    const int flank = across.flank, wide = strip.shape[1];
    Array<double, 1> squares(wide), alike(wide);
    for (int k = 0; k < clarity.shape[0]; ++k) {
        const double share = across.along[k] / std::max(across.along[across.along.size() - 1], 1e-6);
        const Level level = usual_level(levels, share);
        for (int r = 0; r < wide; ++r) squares[r] = square(strip(k, r) - level.usual);
        running_mean(squares, core(across.width_px), Beyond::end_value, alike);
        for (double& each : alike) each = 1.0 / square(1.0 + each / square(ALIKE * level.spread));
        for (int r = 0; r < clarity.shape[1]; ++r) {
            const double own = alike[r + flank], flanks = 0.5 * (alike[r] + alike[r + 2 * flank]);
            clarity(k, r) = std::max(own - flanks, 0.0) + RIDGE_PART * (LEAST_ALIKE + own) * clarity(k, r);
        }
    }
}

}  // namespace

Curves::Curves(int reach_px, ConstMatrix curves_px, ConstVector how_bent, ConstMatrix finer_px)
    : reach(reach_px), curves(curves_px), rows(curves_px.shape[0], CURVE_POINTS), bent(how_bent), finer(finer_px) {
    const double last = 2.0 * reach;
    for (int at = 0; at < rows.size(); ++at)
        rows[at] = static_cast<std::int16_t>(std::min(std::max(0.0, std::rint(curves[at] + reach)), last));
}

Level usual_level(ConstMatrix levels, double share) {
    const int last = levels.shape[0] - 1;
    const double at = std::min(std::max(0.0, share * (last + 1) - 0.5), 1.0 * last);
    const int near = std::min(static_cast<int>(at), last - 1);
    const double part = at - near;
    return {levels(near, 0) * (1.0 - part) + levels(near + 1, 0) * part,
            levels(near, 1) * (1.0 - part) + levels(near + 1, 1) * part};
}

RefinedPath refine_path(const Picture& picture, ConstMatrix path_px, double width_px, double reach_px, double sign) {
    const Columns across = columns_across(path_px, width_px, static_cast<int>(std::ceil(reach_px)));
    if (across.along.size() < 2) return {};
    const auto raw = std::visit([&](auto levels) { return sampled(levels, across, sign); }, picture);
    const Array<double, 2> ridge = bright_ridges(mean_of_columns(raw, 3), across), clarity = clarity_of(ridge);
    const Smoothed stiff = smoothed(clarity, across, {0.7 * reach_px, 3.0, 2.0}, 6);
    return near_curve(ridge, clarity, across, stiff.curve, stiff.clarity);
}

RefinedPath refine_changing_path(const Picture& picture, ConstMatrix path_px, double width_px, const Curves& tried,
                                 ConstMatrix levels) {
    const Columns across = columns_across(path_px, width_px, tried.reach);
    const int count = across.along.size(), reach = across.reach;
    if (count < 2) return {};
    const auto raw = std::visit([&](auto each) { return sampled(each, across, 1.0); }, picture);
    // what is faint in a column shows in several together
    const Array<double, 2> strip = mean_of_columns(raw, FAINT_COLUMNS), ridge = changing_ridges(strip, across);
    // power within a width is as high next to the middle: only the peak counts
    Array<double, 2> clarity = clarity_of(ridge);
    const Array<double, 2> peak = highest_nearby(ridge, PEAK_ROWS);
    for (int at = 0; at < clarity.size(); ++at) clarity[at] *= square(square(ridge[at] / std::max(peak[at], 1e-9)));
    if (levels.shape[0]) as_bright(strip, across, levels, clarity);
    const auto [stiff, other] = clearest_curves(clarity, tried, width_px + BRANCH_PX);
    Array<double, 1> clearest(count);
    double clear = 0.0;
    for (int k = 0; k < count; ++k) {
        const ConstVector row = clarity.row(k);
        const int at = std::clamp(row_at(stiff[k], reach), 1, std::max(2 * reach - 1, 1));
        clearest[k] = *std::max_element(row.begin(), row.end());
        clear += *std::max_element(row.begin() + at - 1, row.begin() + at + 2) / count;
    }
    const double scale = quantile(clearest, 0.75);
    RefinedPath found = near_curve(ridge, clarity, across, stiff, scale);
    found.clear = clear;
    if (other.size()) found.other_px = near_curve(ridge, clarity, across, other, scale).path_px;
    return found;
}

}  // namespace vbaa::detect
