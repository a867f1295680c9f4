#include "detect/ridges.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#include "detect/selection.hpp"
#include "polyline.hpp"

namespace vbaa::detect {
namespace {

constexpr int STEPS[DIRECTIONS][2] = {{0, 1}, {1, 1}, {1, 0}, {1, -1}};
constexpr double LENGTHS[DIRECTIONS] = {1.0, 1.4142135623730951, 1.0, 1.4142135623730951};
// Quantile of the response that is taken as the background's texture.
constexpr double TEXTURE_QUANTILE = 0.8;
// Fraction of their length over which two paths must differ to be two.
constexpr double APART = 0.4;
// Share of a path's samples inside the picture above which its mean over these counts in full.
constexpr double LEAST_INSIDE = 0.3;
// Paths are compared at every so many samples.
constexpr int COMPARED = 8;

using Level = std::uint8_t;

// Levels processed at once, to a multiple of which rows are padded.
constexpr int WHOLE = 64;
int whole(int count) { return (count + WHOLE - 1) / WHOLE * WHOLE; }

// Running maximum: of each value and its neighbours at a distance below `pool`.
void highest(const Level* values, int pool, int count, Level* __restrict to) {
    std::copy(values, values + count, to);
    for (int k = 1; k < pool; ++k) {
        const Level* const __restrict before = values - k;
        const Level* const __restrict after = values + k;
        for (int i = 0; i < count; ++i) {
            const Level other = before[i] > after[i] ? before[i] : after[i];
            to[i] = to[i] > other ? to[i] : other;
        }
    }
}

// Raises responses to those of flat levels against flanks `off` to either side.
void respond(const Level* own, int off, int count, Level* __restrict to) {
    const Level *one = own - off, *other = own + off;
    for (int i = 0; i < count; ++i) {
        const Level flank = std::max(one[i], other[i]);
        to[i] = std::max(to[i], static_cast<Level>(std::max(own[i], flank) - flank));
    }
}

// The direction with the step most nearly across a path along (u, v).
int across(double u, double v) {
    int nearest = 0;
    double most = -1.0;
    for (int step = 0; step < DIRECTIONS; ++step) {
        const double along = std::abs(u * STEPS[step][1] - v * STEPS[step][0]) / LENGTHS[step];
        nearest = along > most ? step : nearest;
        most = std::max(most, along);
    }
    return nearest;
}

// Weight of a response by its level; the quantile TEXTURE_QUANTILE of the responses in the spans is ordinary texture.
std::array<Level, 256> saturating(const Level* flat, const PathTable& paths) {
    // in turn, since a count must be written before it is read again
    std::array<std::array<int, 256>, 4> several{};
    int all = 0;
    for (int k = 0; k < paths.spans.shape[0]; ++k)
        for (int at = paths.spans(k, 0); at < paths.spans(k, 1); ++at, ++all)
            ++several[all % 4][flat[k * paths.columns() + at]];
    std::array<int, 256> counts;
    for (int level = 0; level < 256; ++level)
        counts[level] = several[0][level] + several[1][level] + several[2][level] + several[3][level];
    int ordinary = 1;
    for (int below = counts[0]; below < TEXTURE_QUANTILE * all && ordinary < 255; ++ordinary) below += counts[ordinary];
    std::array<Level, 256> found;
    for (int level = 0; level < 256; ++level) {
        const double over = std::max(level - ordinary, 0);
        found[level] = static_cast<Level>(std::rint(250.0 * over / (over + 3.0 * ordinary)));
    }
    return found;
}

// Rounded means of blocks of two by two numbers of two rows.
void halve(const Level* one, const Level* other, int count, Level* __restrict to) {
    const auto both = [](const Level* row, int i) {  // two neighbours as one number of twice the bits
        std::uint16_t pair;
        std::memcpy(&pair, row + 2 * i, sizeof(pair));
        return static_cast<std::uint16_t>((pair & 0xffU) + (pair >> 8U));
    };
    for (int i = 0; i < count; ++i) to[i] = static_cast<Level>((both(one, i) + both(other, i) + 2U) >> 2U);
}

using Span = std::array<int, 2>;  // columns, from the first to before the last

// A picture's reduced levels where paths need them, with room for flanks and neighbours around.
struct Reduced {
    const PathTable& paths;
    int height, width, room, stride;
    std::vector<Span> needed;  // (height,)
    Array<Level, 3> levels;    // (channels, height + 2 · room + 1, stride), beyond the border as at the border

    Reduced(const PathTable& table, int channels)
        : paths(table),
          height(table.height),
          width(table.width),
          room(std::max(table.reach, table.pool)),
          stride(width + 2 * room + WHOLE),
          needed(height, Span{width, 0}),
          levels(Unset{}, channels, height + 2 * room + 1, stride) {
        const int pool = paths.pool, margin = paths.reach + pool - 1;
        for (int k = 0; k < paths.spans.shape[0]; ++k) {
            const int row = k % paths.rows(), left = paths.spans(k, 0), right = paths.spans(k, 1);
            for (int v = row * pool - margin; left < right && v <= row * pool + margin; ++v) {
                Span& own = needed[std::clamp(v, 0, height - 1)];
                own[0] = std::min(own[0], std::max(left * pool - margin, 0));
                own[1] = std::max(own[1], std::min((right - 1) * pool + margin + 1, width));
            }
        }
    }

    // Means of blocks of pixels; depths other than 8 bits are stretched to the full range.
    template <class T>
    void reduce(Levels<T> picture) {
        constexpr bool small = sizeof(T) == 1;
        using Sum = std::conditional_t<small, std::uint16_t, float>;
        const int channels = picture.shape[2];
        const int down = std::min(paths.factor, picture.shape[0]), right = std::min(paths.factor, picture.shape[1]);
        const float share = 1.0F / static_cast<float>(down * right);
        Array<Sum, 1> sums(Unset{}, picture.shape[1] * channels);
        Array<float, 3> means(Unset{}, small ? 0 : levels.shape[0], height, width);
        std::vector<float> least(levels.shape[0], std::numeric_limits<float>::infinity()),
            most(least.size(), -least[0]);
        for (int v = 0; v < height; ++v) {
            const auto [first, last] = needed[v];
            const int all = (last - first) * right * channels;
            if (all <= 0) continue;
            const auto from = [&, left = first](int r) { return &picture(v * down + r, left * right, 0); };
            if constexpr (small)
                if (down == 2 && right == 2 && channels == 1) {
                    halve(from(0), from(1), last - first, &levels(0, room + v, room + first));
                    continue;
                }
            Sum* const __restrict sum = sums.begin();
            std::copy_n(from(0), all, sum);
            for (int r = 1; r < down; ++r)
                for (int i = 0; i < all; ++i) sum[i] = static_cast<Sum>(sum[i] + static_cast<Sum>(from(r)[i]));
            for (int c = 0; c < levels.shape[0]; ++c)
                for (int u = first; u < last; ++u) {
                    Sum whole = {};
                    for (int k = 0; k < right; ++k)
                        whole = static_cast<Sum>(whole + sum[((u - first) * right + k) * channels + c]);
                    const float mean = share * static_cast<float>(whole);
                    if constexpr (small) {
                        const float above = mean + 0.5F;  // no level is negative
                        levels(c, room + v, room + u) = static_cast<Level>(above);
                    } else {
                        means(c, v, u) = mean;
                        least[c] = std::min(least[c], mean), most[c] = std::max(most[c], mean);
                    }
                }
        }
        for (int c = 0; c < means.shape[0]; ++c)
            for (int v = 0; v < height; ++v)
                for (int u = needed[v][0]; u < needed[v][1]; ++u) {
                    const float scale = 255.0F / std::max(most[c] - least[c], 1e-6F);
                    const float level = (means(c, v, u) - least[c]) * scale + 0.5F;
                    levels(c, room + v, room + u) = static_cast<Level>(std::min(std::max(0.0F, level), 255.0F));
                }
        for (int c = 0; c < levels.shape[0]; ++c) extend(c);
    }

    // Continues a channel's levels beyond the border.
    void extend(int channel) {
        for (int v = 0; v < height; ++v) {
            const auto [first, last] = needed[v];
            Level* const to = &levels(channel, room + v, room);
            if (first < last && first == 0) std::fill_n(to - room, room, to[0]);
            if (first < last && last == width) std::fill_n(to + width, room, to[width - 1]);
        }
        for (int r = 0; r < room; ++r) {
            std::copy_n(&levels(channel, room, 0), stride, &levels(channel, r, 0));
            std::copy_n(&levels(channel, room + height - 1, 0), stride, &levels(channel, room + height + r, 0));
        }
    }

    // Raises flat responses (directions, rows, columns) to those of levels.
    void respond_to(View<const Level, 2> level, Level* flat) const {
        const int pool = paths.pool, rows = paths.rows(), columns = paths.columns();
        const int diagonal = static_cast<int>(std::ceil(paths.reach / std::sqrt(2.0)));
        std::vector<Level> pooled(stride + WHOLE), high(stride + WHOLE);
        for (int k = 0; k < paths.spans.shape[0]; ++k) {
            if (paths.spans(k, 0) >= paths.spans(k, 1)) continue;
            const int step = k / rows, row = k % rows;
            const int left = std::max(paths.spans(k, 0) * pool - pool + 1, 0);
            const int exact = std::min(paths.spans(k, 1) * pool, width) - left, count = whole(exact);
            const int far = STEPS[step][0] != 0 && STEPS[step][1] != 0 ? diagonal : paths.reach;
            const int off = far * (STEPS[step][1] * stride + STEPS[step][0]);
            Level* const own = pooled.data() + room + left;
            std::fill_n(own - pool, count + 2 * pool, Level{0});
            for (int v = std::max((row - 1) * pool + 1, 0); v < std::min((row + 1) * pool, height); ++v)
                respond(&level(room + v, room + left), off, count, own);
            std::fill_n(own + exact, pool, Level{0});
            highest(own, pool, count, high.data());
            Level* const to = flat + k * columns;
            for (int at = paths.spans(k, 0); at < paths.spans(k, 1); ++at)
                to[at] = std::max(to[at], high[at * pool - left]);
        }
    }
};

// Spacing of the columns across the path; wider where that gave more than COLUMNS of them.
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
    const int channels = picture.shape[2], count = 2 * wide + 1, last_left = std::max(width - 2, 0);
    const int beyond = width > 1 ? channels : 0, below = height > 1 ? width * channels : 0;
    const int last_top = std::max(height - 2, 0);
    Array<double, 2> strip(Unset{}, across.along.size(), count);
    std::vector<int> pixel(count);
    std::vector<double> right(count), down(count);
    for (int k = 0; k < strip.shape[0]; ++k) {
        const double du = across.normals(k, 0), dv = across.normals(k, 1);
        const double first_u = across.points(k, 0), first_v = across.points(k, 1);
        int* const __restrict at = pixel.data();
        double* const __restrict to_right = right.data(), * const __restrict to_below = down.data();
        for (int r = 0; r < count; ++r) {
            const double u = std::min(std::max(0.0, first_u + (r - wide) * du), width - 1.0);
            const double v = std::min(std::max(0.0, first_v + (r - wide) * dv), height - 1.0);
            const int left = std::min(static_cast<int>(u), last_left), top = std::min(static_cast<int>(v), last_top);
            at[r] = top * width + left;
            to_right[r] = u - left;
            to_below[r] = v - top;
        }
        double* const __restrict to = strip.row(k).data;
        for (int r = 0; r < count; ++r) {
            const T* const from = picture.data + static_cast<std::ptrdiff_t>(at[r]) * channels;
            const double one = static_cast<double>(from[0]), other = static_cast<double>(from[below]);
            const double near = one + to_right[r] * (static_cast<double>(from[beyond]) - one);
            const double far = other + to_right[r] * (static_cast<double>(from[below + beyond]) - other);
            to[r] = sign * (near + to_below[r] * (far - near));
        }
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

// (K, R) ridge height against texture: saturates at a few times the strip's typical height.
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

PathPlaces places(ConstCube paths_px, const PathTable& paths) {
    const int rows = paths.rows(), columns = paths.columns();
    const int count = paths_px.shape[0], samples = paths_px.shape[1];
    PathPlaces found = {Array<std::int32_t, 2>(count, samples), Array<std::int32_t, 2>(DIRECTIONS * rows, 2),
                        Array<double, 1>(count)};
    for (int k = 0; k < DIRECTIONS * rows; ++k) found.spans(k, 0) = columns;
    const auto reduced = [&](double px) { return std::rint(((px + 0.5) / paths.factor - 0.5) / paths.pool); };
    for (int p = 0; p < count; ++p) {
        const ConstMatrix path = paths_px.row(p);
        for (int s = 0; s < samples; ++s) {
            const int before = std::max(s - 1, 0), after = std::min(s + 1, samples - 1);
            const int direction = across(path(after, 0) - path(before, 0), path(after, 1) - path(before, 1));
            const double column = reduced(path(s, 0)), row = reduced(path(s, 1));
            found.index(p, s) = DIRECTIONS * rows * columns;
            if (!(column >= 0.0 && column < columns && row >= 0.0 && row < rows)) continue;
            const int at = static_cast<int>(column), k = direction * rows + static_cast<int>(row);
            found.index(p, s) = k * columns + at;
            found.weight[p] += 1.0;
            found.spans(k, 0) = std::min(found.spans(k, 0), at),
                           found.spans(k, 1) = std::max(found.spans(k, 1), at + 1);
        }
        found.weight[p] = std::max(found.weight[p], LEAST_INSIDE * samples);
    }
    return found;
}

Array<double, 1> path_scores(const Picture& picture, const PathTable& paths, bool brighter, bool darker) {
    const int cells = DIRECTIONS * paths.rows() * paths.columns();
    Array<Level, 1> flat(cells + 1);
    std::visit(
        [&](auto picture_levels) {
            Reduced reduced(paths, picture_levels.shape[2] >= 3 ? 3 : 1);
            reduced.reduce(picture_levels);
            for (int c = 0; c < reduced.levels.shape[0]; ++c) {
                const View<Level, 2> level = reduced.levels.row(c);
                if (brighter) reduced.respond_to(level, flat.begin());
                if (!darker) continue;
                for (Level& each : level) each = static_cast<Level>(~each);
                reduced.respond_to(level, flat.begin());
            }
        },
        picture);
    const std::array<Level, 256> counted = saturating(flat.begin(), paths);
    Array<double, 1> score(paths.index.shape[0]);
    for (int p = 0; p < score.size(); ++p) {
        std::int32_t total = 0;
        for (const std::int32_t at : paths.index.row(p)) total += counted[flat.begin()[std::min<unsigned>(at, cells)]];
        score[p] = total / paths.weight[p];
    }
    return score;
}

std::vector<int> clearest_paths(ConstVector score, ConstCube paths_px, double apart_px, int count, double share) {
    const int paths = score.shape[0];
    std::vector<int> found = {static_cast<int>(std::max_element(score.begin(), score.end()) - score.begin())};
    std::vector<char> left(paths);
    for (int p = 0; p < paths; ++p) left[p] = score[p] >= share * score[found[0]];
    const auto differs = [&](ConstMatrix path, ConstMatrix best) {
        int apart = 0, several = 0;
        for (int s = 0; s < path.shape[0]; s += COMPARED, ++several)
            apart += std::max(std::abs(path(s, 0) - best(s, 0)), std::abs(path(s, 1) - best(s, 1))) > apart_px;
        return apart >= APART * several;
    };
    while (static_cast<int>(found.size()) < count) {
        int other = -1;
        left[found.back()] = false;
        for (int p = 0; p < paths; ++p) {
            if (!left[p]) continue;
            left[p] = differs(paths_px.row(p), paths_px.row(found.back()));
            if (left[p] && (other < 0 || score[p] > score[other])) other = p;
        }
        if (other < 0) break;
        found.push_back(other);
    }
    return found;
}

Array<double, 2> refine_path(const Picture& picture, ConstMatrix path_px, double width_px, double reach_px,
                             double sign) {
    const Columns across = columns_across(path_px, width_px, static_cast<int>(std::ceil(reach_px)));
    if (across.along.size() < 2) return {};
    const auto raw = std::visit([&](auto levels) { return sampled(levels, across, sign); }, picture);
    const Array<double, 2> clarity = clarity_of(bright_ridges(mean_of_columns(raw, 3), across));
    return near_curve(clarity, across, smoothed(clarity, across, {0.7 * reach_px, 3.0, 2.0}, 6));
}

}  // namespace vbaa::detect
