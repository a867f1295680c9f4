// The antenna's visible end: a blurred step in the heights along the line.
#include "detect/visible_end.hpp"

#include "polyline.hpp"

namespace vbaa::detect {

namespace {

constexpr double BEFORE_PX = 60.0;      // of the line before its end that is examined
constexpr int BEYOND_PX = 24;           // of the picture beyond it
constexpr double STRAIGHT_PX = 30.0;    // of the line that give its direction at the end, which carries no moment
constexpr double CLEAN_PX = 5.0;        // beyond a tip nothing is visible for so many pixels, and its blur
constexpr double LEAST_CONTRAST = 8.0;  // of the mean profile before the end: height over its own deviation
constexpr double BLUR_PX = 0.8;         // initial blur of the step,
constexpr double BLUR_STD = 0.2;        // its prior deviation, px,
constexpr double LEAST_BLUR_PX = 0.3, LARGEST_BLUR_PX = 4.0;  // and what is possible
// Share of a whole antenna's length, and pixels, by which a line that ends earlier may be hidden by something that
// looks like the background.
constexpr double SHORTER = 0.06, SHORTER_PX = 8.0;
constexpr double BROAD = 1.25;        // factor by which a ball, a sheath or a kink raises the height there
constexpr double EDGE = 0.2;          // part of the line's height by which its background may change where it ends
constexpr double MOST_LONGER = 0.15;  // part by which a line may go on beyond its path; then something else begins
constexpr int AT_LEAST_ON = 12;       // profiles beyond the path's end that show a line that is longer than its path
constexpr double MOST_STD_PX = 1.5, MOST_RMS = 0.2;  // of a step that is to be trusted
constexpr int ROUNDS = 12;
constexpr double LEAST_STD_PX = 0.1;  // error by the pixel grid and the shape of a cut end, over the blur
// Least number of profiles before the end, and of those that a step is fitted to.
constexpr int LEAST_BEFORE = 8, LEAST_STEP = 16;

// A line from some way before its last seen point, continued straight beyond it; no points where it is too short.
struct Continued {
    Table path_px;
    int last;                  // index of the last point seen
    double whole_px, rest_px;  // length of the whole path, and of its unseen part at the end
};

// A blurred step from `height` to nothing.
struct Step {
    bool there = false;
    double place, blur, height, std, rms;  // px; deviation of the place; residuals
};

// Measurements of N profiles: places, px; heights and background over the usual height; residuals over the noise.
struct Profiles {
    Numbers at, heights, background, residuals;
};

int last_of(const Flags& seen) {
    int last = seen.size() - 1;
    while (!seen[last]) --last;
    return last;
}

Continued continued(ConstMatrix path_px, const Flags& seen) {
    const Numbers along = arc_lengths(path_px);
    const int last = last_of(seen);
    const double end_at = along[last], whole = along[along.size() - 1];
    int first = 0;
    while (along[first] < end_at - BEFORE_PX) ++first;
    const std::vector<int> near = places(
        each(seen.size(), [&](int k) { return seen[k] && along[k] > end_at - STRAIGHT_PX && along[k] <= end_at; }));
    if (near.size() < 8 || last - first < 12) return {Table(0, 2), 0, whole, whole - end_at};
    const double count = static_cast<double>(near.size());
    double middle = 0.0, square_sum = 0.0;
    for (int k : near) middle += (along[k] - end_at) / count;
    for (int k : near) square_sum += square(along[k] - end_at - middle);
    Point end, direction;
    for (int axis = 0; axis < 2; ++axis) {
        double mean = 0.0, product = 0.0;
        for (int k : near) {
            mean += path_px(k, axis) / count;
            product += (along[k] - end_at - middle) * path_px(k, axis);
        }
        direction[axis] = product / square_sum;
        end[axis] = mean - direction[axis] * middle;
    }
    const double norm = std::hypot(direction[0], direction[1]);
    const int own = last + 1 - first;
    Table path(own + BEYOND_PX, 2);
    std::copy(path_px.row(first).data, path_px.row(first).data + 2 * own, path.begin());
    for (int k = 0; k < BEYOND_PX; ++k)
        for (int axis = 0; axis < 2; ++axis) path(own + k, axis) = end[axis] + (k + 1.0) * (direction[axis] / norm);
    return {std::move(path), last - first, whole, whole - end_at};
}

// The least-squares step from a constant to nothing in heights (N,), and that constant.
Step cut(const Numbers& at, const Numbers& heights) {
    Step found = {};
    found.blur = BLUR_PX;
    double best = INFINITY, sum = 0.0;
    for (int k = 0; k < at.size() - 2; ++k) {
        sum += heights[k];
        const double left = -sum * sum / (k + 1);  // without the term that is the same for all k
        if (k < 4 || !(left < best)) continue;
        best = left;
        found.place = 0.5 * (at[k] + at[k + 1]);
        found.height = sum / (k + 1);
    }
    return found;
}

// One Gauss–Newton step of place, blur and height, for heights (N,) of weights (N,). Returns the change of the place.
double improve(Step& step, const Numbers& at, const Numbers& heights, const Numbers& weight) {
    constexpr double prior = 1.0 / (BLUR_STD * BLUR_STD);
    std::array<double, 9> matrix = {1e-9, 0.0, 0.0, 0.0, prior + 1e-9, 0.0, 0.0, 0.0, 1e-9};
    std::array<double, 6> sides = {0.0, 1.0, prior * (BLUR_PX - step.blur)};
    for (int k = 0; k < at.size(); ++k) {
        const double away = (step.place - at[k]) / step.blur;
        const double bell = step.height * std::exp(-0.5 * away * away) / (std::sqrt(2.0 * M_PI) * step.blur);
        const std::array<double, 3> row = {bell, -bell * away, 0.5 * std::erfc(-away / std::sqrt(2.0))};
        for (int i = 0; i < 3; ++i) {
            const double weighted = square(weight[k]) * row[i];
            sides[2 * i] += weighted * (heights[k] - step.height * row[2]);
            for (int j = 0; j <= i; ++j) matrix[3 * i + j] += weighted * row[j];
        }
    }
    solve_definite(Matrix(matrix.data(), {3, 3}), Matrix(sides.data(), {3, 2}));
    const double move = bounded(sides[0], -2.0, 2.0);
    step.std = std::sqrt(sides[1]);
    step.place += move;
    step.blur = bounded(step.blur + sides[2], LEAST_BLUR_PX, LARGEST_BLUR_PX);
    step.height += sides[4];
    return move;
}

// The blurred step fitted to heights (N,) with standard deviations (N,) at places (N,); without a height where there is
// none.
Step fitted_step(const Numbers& at, const Numbers& heights, const Numbers& sigma) {
    if (at.size() < LEAST_STEP) return {};
    Step step = cut(at, heights);
    const Flags near =
        each(at.size(), [&](int k) { return at[k] > step.place - BEFORE_PX && at[k] < step.place + BEYOND_PX; });
    const Numbers s = selected(at, near), h = selected(heights, near), deviation = selected(sigma, near);
    const int count = s.size();
    const Numbers weight = each(count, [&](int k) { return 1.0 / std::max(deviation[k], 1e-6); });
    if (std::count_if(s.begin(), s.end(), [&](double place) { return place > step.place + 2.0; }) < 3) return {};
    for (int round = 0; round < ROUNDS; ++round)
        if (std::abs(improve(step, s, h, weight)) < 1e-4) break;
    double weighted = 0.0, plain = 0.0;
    for (int k = 0; k < count; ++k) {
        const double below = 0.5 * std::erfc(-(step.place - s[k]) / (step.blur * std::sqrt(2.0)));
        const double left = square(h[k] - step.height * below);
        weighted += left * square(weight[k]);
        plain += left;
    }
    const double typical = central(each(count, [&](int k) { return 1.0 / weight[k]; }));
    if (step.height < LEAST_CONTRAST * typical / std::sqrt(8.0) || !(s[0] < step.place && step.place < s[count - 1]))
        return {};
    step.there = true;
    step.std =
        std::hypot(step.std * std::max(1.0, std::sqrt(weighted / count)), LEAST_STD_PX * std::max(step.blur, 1.0));
    step.rms = std::sqrt(plain / count);
    return step;
}

EndKind kind_of(const Profiles& seen, const Step& step) {
    const double gone = step.place + 2.0 * step.blur;
    const Flags after = each(seen.at.size(), [&](int n) { return seen.at[n] > gone && seen.at[n] < gone + CLEAN_PX; });
    const Flags near = each(seen.at.size(), [&](int n) {
        return seen.at[n] > step.place - 2.0 * CLEAN_PX && seen.at[n] < step.place - 2.0 * step.blur;
    });
    const auto share_above = [&](double bound, const Flags& where) {
        const Numbers residuals = selected(seen.residuals, where);
        const auto above = [&](double residual) { return residual > bound; };
        return static_cast<double>(std::count_if(residuals.begin(), residuals.end(), above)) / residuals.size();
    };
    if (count(after) < 3 || count(near) < 3 || share_above(DISTURBED_RMS, after) > 0.4) return EndKind::hidden;
    if (std::abs(central(selected(seen.background, after)) - central(selected(seen.background, near))) > EDGE)
        return EndKind::hidden;
    const Numbers heights = selected(seen.heights, near);
    const bool swollen =
        *std::max_element(heights.begin(), heights.end()) > BROAD || share_above(2.0 * DISTURBED_RMS, near) > 0.3;
    return swollen || step.std > MOST_STD_PX || step.rms > MOST_RMS ? EndKind::unsure : EndKind::tip;
}

// The end, and points (M, 2) of the line beyond its path where it goes on there.
struct End {
    VisibleEnd end;
    Table longer;
};

// `Profiles` of the chosen crossings.
Profiles profiles_at(const std::vector<int>& used, const Crossings& found, const Fits& fits, double usual,
                     double noise) {
    const int count = static_cast<int>(used.size());
    const auto background = [&](int k) {
        const ConstVector profile = found.profiles.row(used[k]);
        return 0.25 * (profile[0] + profile[1] + profile.end()[-2] + profile.end()[-1]) / usual;
    };
    return {each(count, [&](int k) { return found.along[used[k]]; }),
            each(count, [&](int k) { return fits.height[used[k]] / usual; }), each(count, background),
            each(count, [&](int k) { return fits.rms[used[k]] / noise; })};
}

End end_or_longer(const Crossings& found, const Look& look, const Continued& ahead) {
    const Numbers &here = found.along, along = arc_lengths(ahead.path_px);  // from the path's first examined point
    const double last_at = along[ahead.last];
    const int count_all = here.size();
    End end = {{EndKind::hidden, {ahead.path_px(ahead.last, 0), ahead.path_px(ahead.last, 1)}, NAN}, Table(0, 2)};
    const Fits fits = fit(look.section, found, Numbers(count_all));
    const Flags known = each(count_all, [&](int n) { return found.inside[n] && here[n] < last_at - 4.0; });
    if (count(known) < LEAST_BEFORE) return end;
    const double usual = median(selected(fits.height, known));
    if (usual <= 0.0) return end;
    // only profiles before the picture's border
    bool edge = false;
    int stop = count_all;
    for (int n = count_all - 1; n >= 0; --n)
        if (!found.inside[n] && here[n] > last_at - 1.0) edge = edge || here[n] < last_at + BEYOND_PX, stop = n;
    const std::vector<int> used = places(each(edge ? stop : count_all, [&](int n) { return found.inside[n] != 0; }));
    const Flags on = each(count_all, [&](int n) {
        return found.inside[n] && here[n] > last_at && fits.height[n] > 0.5 * usual && !edge;
    });
    if (count(on) >= AT_LEAST_ON && last_of(on) >= used.end()[-3]) {
        // bent towards the camera, it is longer in the picture than a whole antenna of the corridor
        end.longer = selected(moved(found, fits.shift), on);
        return end;
    }
    const Profiles seen = profiles_at(used, found, fits, usual, look.noise);
    const Step step =
        fitted_step(seen.at, seen.heights,
                    each(seen.at.size(), [&](int k) { return look.noise * fits.unit_height[used[k]] / usual; }));
    if (!step.there || (edge && seen.at[seen.at.size() - 1] < step.place + CLEAN_PX + 2.0 * step.blur)) {
        if (edge) end.end.kind = EndKind::border;
        return end;
    }
    EndKind kind = kind_of(seen, step);
    if (kind == EndKind::hidden) return end;
    const double missing = ahead.rest_px - (step.place - last_at);
    if (kind == EndKind::tip && missing > std::max(SHORTER * ahead.whole_px, SHORTER_PX)) kind = EndKind::unsure;
    end.end = {kind, {}, step.std};
    for (int axis = 0; axis < 2; ++axis) {
        const Numbers values = each(along.size(), [&](int k) { return ahead.path_px(k, axis); });
        end.end.place[axis] = interpolated(along, values, step.place);
    }
    return end;
}

double length(ConstMatrix path_px) { return arc_lengths(path_px)[path_px.shape[0] - 1]; }

// A path's first rows, then others.
Table appended(const Table& path_px, int rows, const Table& others) {
    Table whole(Unset{}, rows + others.shape[0], 2);
    std::copy(path_px.begin(), path_px.begin() + 2 * rows, whole.begin());
    std::copy(others.begin(), others.end(), whole.begin() + 2 * rows);
    return whole;
}

}  // namespace

Table to_its_end(const Picture& picture, ConstMatrix path_px, const Look& look) {
    Table path = resample(path_px, 1.0).points;
    if (path.shape[0] < 2) return path;
    constexpr int blurred_px = 2;  // before a line's end in which only its blurred tip is visible
    const double farthest_px = (1.0 + MOST_LONGER) * length(path);
    while (true) {
        const Continued ahead = continued(path, each(path.shape[0], [](int) { return true; }));
        if (!ahead.path_px.size()) return path;
        const Crossings found = crossings(picture, ahead.path_px, look.half, look.sign, look.channel);
        const int all = found.along.size();
        const double last_at = arc_lengths(ahead.path_px)[ahead.last];
        const Fits fits = fit(look.section, found, Numbers(all));
        const Flags known = each(all, [&](int n) { return found.inside[n] && found.along[n] < last_at - 4.0; });
        if (count(known) < LEAST_BEFORE) return path;
        const double least = 0.5 * median(selected(fits.height, known));
        int first = 0;
        while (first < all && found.along[first] <= last_at) ++first;
        int end = first;
        while (end < all && found.inside[end] && fits.height[end] > least) ++end;
        const int clear = end < all ? end - blurred_px : end;
        if (!(least > 0.0) || clear <= first) return path;
        const Flags on = each(all, [&](int n) { return n >= first && n < clear; });
        path = appended(path, path.shape[0], selected(moved(found, fits.shift), on));
        if (length(path) > farthest_px) return resample(path_px, 1.0).points;
        if (end < all) return path;
    }
}

VisibleEnd visible_end(const Picture& picture, ConstMatrix path_px, const Flags& seen, const Look& look) {
    const double farthest_px = (1.0 + MOST_LONGER) * length(path_px);
    Table path(path_px);
    Flags visible = seen;
    while (true) {
        const int last = last_of(visible);
        const Continued ahead = continued(path, visible);
        if (!ahead.path_px.size()) return {EndKind::hidden, {path(last, 0), path(last, 1)}, NAN};
        const End found =
            end_or_longer(crossings(picture, ahead.path_px, look.half, look.sign, look.channel), look, ahead);
        const int more = found.longer.shape[0], whole = last + 1 + more;
        if (!more) return found.end;
        path = appended(path, last + 1, found.longer);
        visible.values.resize(whole);
        std::fill(visible.begin() + last + 1, visible.end(), true);
        visible.shape[0] = whole;
        if (length(path) > farthest_px) return {EndKind::unsure, {path(whole - 1, 0), path(whole - 1, 1)}, NAN};
    }
}

}  // namespace vbaa::detect
