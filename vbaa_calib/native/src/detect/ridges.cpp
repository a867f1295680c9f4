#include "detect/ridges.hpp"

#include <algorithm>
#include <cmath>

namespace vbaa::detect {
namespace {

constexpr int STEPS[DIRECTIONS][2] = {{0, 1}, {1, 1}, {1, 0}, {1, -1}};
constexpr double LENGTHS[DIRECTIONS] = {1.0, 1.4142135623730951, 1.0, 1.4142135623730951};
// Quantile of the response that is taken as the background's texture.
constexpr double TEXTURE_QUANTILE = 0.8;
// Fraction of their length over which two paths must differ to be two.
constexpr double APART = 0.4;
// Quantiles are taken of about so many responses; paths are compared at every so many samples.
constexpr int QUANTILE_OF = 20'000, COMPARED = 8;

using Level = std::uint8_t;

// Of some values each the highest of it and its neighbours nearer than `pool` of them.
void highest(const Level* values, int pool, int count, Level* __restrict to) {
    std::copy(values, values + count, to);
    for (int k = 1; k < pool; ++k) {
        const Level *before = values - k, *after = values + k;
        for (int i = 0; i < count; ++i) to[i] = std::max(to[i], std::max(before[i], after[i]));
    }
}

// The response of each of some flat levels against flanks `off` to either side, where it is higher than what is there.
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

// What a response counts, by its level, where such a part of the responses is ordinary texture.
std::array<std::int32_t, 256> saturating(Bytes flat) {
    std::array<int, 256> counts{};
    const int step = 1 + flat.size() / QUANTILE_OF, few = (flat.size() + step - 1) / step;
    for (int at = 0; at < flat.size(); at += step) ++counts[flat[at]];
    int ordinary = 1;
    for (int below = counts[0]; below < TEXTURE_QUANTILE * few; ++ordinary) below += counts[ordinary];
    std::array<std::int32_t, 256> found;
    for (int level = 0; level < 256; ++level) {
        const double over = std::max(level - ordinary, 0);
        found[level] = static_cast<std::int32_t>(std::rint(250.0 * over / (over + 3.0 * ordinary)));
    }
    return found;
}

}  // namespace

Array<std::int32_t, 2> places(ConstCube paths_px, const Reduction& reduction) {
    const int factor = reduction.factor, pool = reduction.pool;
    const int rows = reduction.rows, columns = reduction.columns;
    const int count = paths_px.shape[0], samples = paths_px.shape[1];
    Array<std::int32_t, 2> index(count, samples);
    const auto reduced = [&](double px) { return std::rint(((px + 0.5) / factor - 0.5) / pool); };
    for (int p = 0; p < count; ++p) {
        const ConstMatrix path = paths_px.row(p);
        for (int s = 0; s < samples; ++s) {
            const int before = std::max(s - 1, 0), after = std::min(s + 1, samples - 1);
            const int direction = across(path(after, 0) - path(before, 0), path(after, 1) - path(before, 1));
            const double column = reduced(path(s, 0)), row = reduced(path(s, 1));
            const bool inside = column >= 0.0 && column < columns && row >= 0.0 && row < rows;
            index(p, s) = inside ? (direction * rows + static_cast<int>(row)) * columns + static_cast<int>(column)
                                 : DIRECTIONS * rows * columns;
        }
    }
    return index;
}

Array<std::uint8_t, 1> ridge_responses(BytePicture small, int reach, int pool, int sign) {
    const int height = small.shape[0], width = small.shape[1];
    // around the picture, room for flanks and neighbours
    const int room = std::max(reach, pool), stride = width + 2 * room, tall = height + 2 * room;
    const int rows = (height + pool - 1) / pool, columns = (width + pool - 1) / pool;
    std::vector<Level> level(tall * stride), pooled(stride), high(width);
    for (int r = 0; r < tall; ++r) {
        const View<const Level, 1> own = small.row(std::clamp(r - room, 0, height - 1));
        Level* to = level.data() + r * stride;
        std::fill(to, to + room, own[0]);
        std::copy(own.begin(), own.end(), to + room);
        std::fill(to + room + width, to + stride, own[width - 1]);
    }
    if (sign < 0)
        for (Level& each : level) each = static_cast<Level>(~each);
    Array<Level, 1> flat(DIRECTIONS * rows * columns + 1);
    const int diagonal = static_cast<int>(std::ceil(reach / std::sqrt(2.0)));
    for (int row = 0; row < rows; ++row)
        for (int step = 0; step < DIRECTIONS; ++step) {
            const int far = STEPS[step][0] != 0 && STEPS[step][1] != 0 ? diagonal : reach;
            const int off = far * (STEPS[step][1] * stride + STEPS[step][0]);
            std::fill_n(pooled.data() + room, width, Level{0});
            for (int v = std::max((row - 1) * pool + 1, 0); v < std::min((row + 1) * pool, height); ++v)
                respond(level.data() + (room + v) * stride + room, off, width, pooled.data() + room);
            highest(pooled.data() + room, pool, width, high.data());
            Level* const to = flat.begin() + (step * rows + row) * columns;
            for (int column = 0; column < columns; ++column) to[column] = high[column * pool];
        }
    return flat;
}

Array<double, 1> scores(Bytes flat, View<const std::int32_t, 2> index, ConstVector weight) {
    const std::array<std::int32_t, 256> counted = saturating(flat);
    const unsigned last = flat.size() - 1;
    Array<double, 1> score(index.shape[0]);
    for (int p = 0; p < score.size(); ++p) {
        std::int32_t total = 0;
        for (const std::int32_t at : index.row(p)) total += counted[flat.data[std::min<unsigned>(at, last)]];
        score[p] = total / weight[p];
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

}  // namespace vbaa::detect
