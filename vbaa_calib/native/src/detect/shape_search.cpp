#include "detect/shape_search.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "detect/ridges.hpp"
#include "detect/selection.hpp"
#include "polyline.hpp"
#include "smooth.hpp"

namespace vbaa::detect {
namespace {

constexpr int MOST_CHANNELS = 3, PLACES = 8, DIRECTIONS_ROUGH = 8;
constexpr double STRIP_STEP_PX = 0.5, SMOOTHED_PX = 5.0;  // of strips: across, and how much of it along is averaged
constexpr double EDGE_GAP_PX = 0.4, EDGE_PX = 2.0;  // next to an edge, left out for the blur; and compared, beyond that
constexpr double USUAL_QUANTILE = 0.35, USUAL_SQUARE = 0.2;  // of squares of normal numbers, for their deviation
constexpr double LEAST_VARIANCE = 0.25;                     // of a difference: light is never quite even
constexpr double REDUCED_WIDTH_PX = 1.6;                    // least width in the reduced picture
constexpr double ROOT = 0.22;                               // first part, in which hardly anything hides an antenna

using Colour = std::array<float, MOST_CHANNELS>;
using Point = std::array<double, 2>;

// Log odds of an edge, by the log odds without a background's own edges: tabled.
struct EdgeOdds {
    static constexpr double LOW = -8.0, HIGH = 12.0;
    static constexpr int ROWS = 1024;
    std::array<float, ROWS + 1> table;

    explicit EdgeOdds(double rate) {
        for (int row = 0; row <= ROWS; ++row) {
            const double odds = LOW + (HIGH - LOW) * row / ROWS;
            table[row] = static_cast<float>(-std::log((1.0 - rate) * std::exp(-odds) + rate));
        }
    }
    float operator()(float odds) const {
        const float place = (odds - static_cast<float>(LOW)) * static_cast<float>(ROWS / (HIGH - LOW));
        return table[static_cast<int>(std::min(std::max(place, 0.0f), static_cast<float>(ROWS)))];
    }
};

// A picture's luma and colour differences, with some rows and columns more on every side.
struct Planes {
    int rows = 0, columns = 0, pad = 0, stride = 0, channels = 0;
    std::array<std::vector<float>, MOST_CHANNELS> levels;

    Planes(int height, int width, int more, int several)
        : rows(height), columns(width), pad(more), stride(width + 2 * more), channels(several) {
        for (int k = 0; k < channels; ++k) levels[k].resize(static_cast<std::size_t>(stride) * (rows + 2 * pad));
    }
    std::size_t size() const { return levels[0].size(); }
    std::size_t at(int row, int column) const { return static_cast<std::size_t>(row + pad) * stride + column + pad; }
    // Repeats the border's values beyond it.
    void extend() {
        for (int k = 0; k < channels; ++k) {
            float* const plane = levels[k].data();
            for (int row = 0; row < rows; ++row) {
                float* const line = plane + at(row, 0);
                std::fill(line - pad, line, line[0]);
                std::fill(line + columns, line + columns + pad, line[columns - 1]);
            }
            for (int row = 0; row < pad; ++row) {
                std::copy_n(plane + at(0, -pad), stride, plane + at(-1 - row, -pad));
                std::copy_n(plane + at(rows - 1, -pad), stride, plane + at(rows + row, -pad));
            }
        }
    }
};

// Luma and two differences of blue, green and red.
Colour opponent(float b, float g, float r) { return {(b + g + r) / 3.0f, 0.5f * (r - b), 0.25f * (2.0f * g - r - b)}; }

// Levels of one kind as colours of 8 bits.
template <class T>
struct Colours {
    Levels<T> levels;
    float scale = std::is_same_v<T, std::uint16_t> ? 1.0f / 257.0f : 1.0f;

    bool coloured() const { return levels.shape[2] >= 3; }
    Colour at(int row, int column) const {
        const T* const own = &levels(row, column, 0);
        if (!coloured()) return {scale * static_cast<float>(own[0])};
        return opponent(scale * static_cast<float>(own[0]), scale * static_cast<float>(own[1]),
                        scale * static_cast<float>(own[2]));
    }
};

// Blocks of `factor` pixels averaged.
template <class T>
Planes reduced(const Colours<T>& picture, int factor, int pad) {
    const int rows = std::max(picture.levels.shape[0] / factor, 1), columns = std::max(picture.levels.shape[1] / factor, 1);
    Planes small(rows, columns, pad, picture.coloured() ? 3 : 1);
    const int down = std::min(factor, picture.levels.shape[0]), right = std::min(factor, picture.levels.shape[1]);
    const float share = 1.0f / static_cast<float>(down * right);
    for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column) {
            Colour sum = {};
            for (int v = 0; v < down; ++v)
                for (int u = 0; u < right; ++u) {
                    const Colour own = picture.at(row * factor + v, column * factor + u);
                    for (int k = 0; k < small.channels; ++k) sum[k] += own[k];
                }
            for (int k = 0; k < small.channels; ++k) small.levels[k][small.at(row, column)] = share * sum[k];
        }
    small.extend();
    return small;
}

// Deviation of a pixel's noise in each channel, by second differences both ways at some thousands of places.
template <class T>
Colour noise_of(const Colours<T>& picture) {
    const int height = picture.levels.shape[0], width = picture.levels.shape[1], several = picture.coloured() ? 3 : 1;
    const int step = std::max(1, static_cast<int>(std::sqrt(height * static_cast<double>(width) / 6000.0)));
    std::array<std::vector<double>, MOST_CHANNELS> found;
    for (int row = 1; row < height - 1; row += step)
        for (int column = 1; column < width - 1; column += step) {
            Colour sum = {};
            for (int v = -1; v <= 1; ++v)
                for (int u = -1; u <= 1; ++u) {
                    const Colour own = picture.at(row + v, column + u);
                    const float weight = static_cast<float>((v ? 1 : -2) * (u ? 1 : -2));
                    for (int k = 0; k < several; ++k) sum[k] += weight * own[k];
                }
            for (int k = 0; k < several; ++k) found[k].push_back(std::abs(sum[k]) / 6.0);
        }
    Colour noise = {};
    for (int k = 0; k < several; ++k)
        noise[k] = found[k].empty() ? 1.0f : static_cast<float>(median({found[k].data(), {static_cast<int>(found[k].size())}}) / 0.6745 + 0.3);
    return noise;
}

// The plane moved by (u, v), linear in between: into `to`, where there is room for it.
void moved_by(const Point& by, const std::vector<float>& plane, const Planes& layout, std::vector<float>& to) {
    const int left = static_cast<int>(std::floor(by[0])), up = static_cast<int>(std::floor(by[1]));
    const float u = static_cast<float>(by[0] - left), v = static_cast<float>(by[1] - up);
    const std::ptrdiff_t off = static_cast<std::ptrdiff_t>(up) * layout.stride + left;
    const int margin = (std::max(std::abs(up), std::abs(left)) + 1) * (layout.stride + 1);
    const int last = static_cast<int>(layout.size()) - margin;
    const float a = (1.0f - u) * (1.0f - v), b = u * (1.0f - v), c = (1.0f - u) * v, d = u * v;
    const float *from = plane.data() + off, *below = from + layout.stride;
    float* const __restrict into = to.data();
    for (int i = margin; i < last; ++i) into[i] = a * from[i] + b * from[i + 1] + c * below[i] + d * below[i + 1];
}

// The rough search's maps: log odds of two edges by direction, and of the looks by place, highest within a pool.
struct RoughMaps {
    int rows, columns, factor;
    std::vector<std::vector<float>> edges, looks;
};

void pool_rows(std::vector<float>& values, int stride, int pool) {
    std::vector<float> high(values);
    const int count = static_cast<int>(values.size());
    for (int by = 1; by <= pool; ++by) {
        const int off = by * stride;
        for (int i = off; i < count - off; ++i) high[i] = std::max(high[i], std::max(values[i - off], values[i + off]));
    }
    values = std::move(high);
}

// What is known of how the antenna looks: mean and variance by place and channel.
struct Look {
    std::array<Colour, PLACES> mean, variance;
};

constexpr Colour WORLD_VARIANCE = {3600.0f, 400.0f, 400.0f}, WORLD_MEAN = {100.0f, 0.0f, 0.0f};

Look look_of(ConstMatrix looks) {
    Look look;
    for (int p = 0; p < PLACES; ++p) {
        const double* const own = looks.row(p).data;
        look.mean[p] = opponent(static_cast<float>(own[0]), static_cast<float>(own[1]), static_cast<float>(own[2]));
        const float spread = static_cast<float>(own[3]), hue = 4.0f + 0.15f * spread;
        look.variance[p][0] = spread * spread + 0.0625f * look.mean[p][0] * look.mean[p][0];
        for (int k = 1; k < 3; ++k)
            look.variance[p][k] = hue * hue + 0.09f * look.mean[p][k] * look.mean[p][k];
    }
    return look;
}

// Log odds of a colour to be the antenna's, against any.
struct LookOdds {
    Colour mean, inverse;
    float constant = 0.0f, most;

    LookOdds(const Colour& usual, const Colour& variance, double limit) : mean(usual), most(static_cast<float>(limit)) {
        for (int k = 0; k < MOST_CHANNELS; ++k) {
            inverse[k] = 1.0f / variance[k];
            constant += 0.5f * std::log(WORLD_VARIANCE[k] * inverse[k]);
        }
    }
    float operator()(const Colour& own) const {
        float odds = constant;
        for (int k = 0; k < MOST_CHANNELS; ++k) {
            const float off = own[k] - mean[k], any = own[k] - WORLD_MEAN[k];
            odds += 0.5f * (any * any * (1.0f / WORLD_VARIANCE[k]) - off * off * inverse[k]);
        }
        return std::min(std::max(odds, -most), most);
    }
};

double spread_of(const EdgeModel& model, int channel) { return channel ? model.colour_spread : model.spread; }

// Log odds at edges of a whole plane's differences, whose usual size is that of blocks near by.
void edge_map(const std::array<std::vector<float>, MOST_CHANNELS>& differences, const Planes& layout,
              const Colour& noise, const EdgeModel& model, const EdgeOdds& odds, std::vector<float>& map) {
    constexpr int BLOCK = 8;
    const int tall = layout.rows + 2 * layout.pad, rows = (tall + BLOCK - 1) / BLOCK;
    const int columns = (layout.stride + BLOCK - 1) / BLOCK;
    std::vector<float> clearest(map.size(), -1e9f);
    std::vector<float> mean(static_cast<std::size_t>(rows) * columns), scale(layout.stride), low(layout.stride);
    for (int k = 0; k < layout.channels; ++k) {
        const float* const off = differences[k].data();
        for (int r = 0; r < rows; ++r)
            for (int c = 0; c < columns; ++c) {
                const int bottom = std::min((r + 1) * BLOCK, tall), right = std::min((c + 1) * BLOCK, layout.stride);
                float sum = 0.0f;
                for (int v = r * BLOCK; v < bottom; ++v)
                    for (int u = c * BLOCK; u < right; ++u) {
                        const float own = off[v * layout.stride + u];
                        sum += std::min(own * own, 400.0f);
                    }
                mean[r * columns + c] = sum / static_cast<float>((bottom - r * BLOCK) * (right - c * BLOCK));
            }
        const double least = std::max(static_cast<double>(noise[k]) * noise[k], LEAST_VARIANCE);
        const double wide = 2.0 * square(spread_of(model, k));
        for (int v = 0; v < tall; ++v) {
            const int r = v / BLOCK;
            if (v % BLOCK == 0)
                for (int c = 0; c < columns; ++c) {
                    double near = 0.0;
                    int several = 0;
                    for (int i = std::max(r - 1, 0); i <= std::min(r + 1, rows - 1); ++i)
                        for (int j = std::max(c - 1, 0); j <= std::min(c + 1, columns - 1); ++j, ++several)
                            near += mean[i * columns + j];
                    const double variance = std::max(least, 0.3 * near / several), all = variance + wide;
                    const int right = std::min((c + 1) * BLOCK, layout.stride);
                    const float inverse = static_cast<float>(0.5 / variance - 0.5 / all);
                    const float log = static_cast<float>(0.5 * std::log(all / variance));
                    std::fill(scale.begin() + c * BLOCK, scale.begin() + right, inverse);
                    std::fill(low.begin() + c * BLOCK, low.begin() + right, log);
                }
            for (int u = 0; u < layout.stride; ++u) {
                const float own = off[v * layout.stride + u];
                float& best = clearest[v * layout.stride + u];
                best = std::max(best, own * own * scale[u] - low[u]);
            }
        }
    }
    const float several = static_cast<float>(std::log(layout.channels));
    for (std::size_t i = 0; i < map.size(); ++i) map[i] = odds(clearest[i] - several);
}

template <class T>
RoughMaps rough_maps(const Colours<T>& picture, const ShapeFamily& family, const Look* look, Colour noise,
                     const EdgeModel& model, const EdgeOdds& odds) {
    const int factor = std::max(1, static_cast<int>(family.width_px / REDUCED_WIDTH_PX));
    const double reach = 0.5 * family.width_px / factor + 1.0;
    const int pad = static_cast<int>(std::ceil(reach)) + 4;
    Planes small = reduced(picture, factor, pad);
    for (float& each : noise) each /= static_cast<float>(factor);
    RoughMaps maps = {small.rows, small.columns, factor, {}, {}};
    const int pool = std::max(1, static_cast<int>(std::ceil(0.5 * family.spacing_px / factor)));
    Planes along = small, apart = small;
    std::vector<float> one(small.size()), other(small.size()), map(small.size());
    // the same as it is moved, without the room around it, highest within the pool
    const auto pooled = [&](std::vector<float>& values) {
        pool_rows(values, small.stride, pool);
        pool_rows(values, 1, pool);
        std::vector<float> kept(static_cast<std::size_t>(small.rows) * small.columns);
        for (int row = 0; row < small.rows; ++row)
            std::copy_n(values.data() + small.at(row, 0), small.columns, kept.data() + row * small.columns);
        return kept;
    };
    for (int direction = 0; direction < DIRECTIONS_ROUGH; ++direction) {
        const double angle = M_PI * direction / DIRECTIONS_ROUGH, u = std::cos(angle), v = std::sin(angle);
        for (int k = 0; k < small.channels; ++k) {
            moved_by({u, v}, small.levels[k], small, one);
            moved_by({-u, -v}, small.levels[k], small, other);
            for (std::size_t i = 0; i < one.size(); ++i)
                along.levels[k][i] = (one[i] + other[i] + small.levels[k][i]) / 3.0f;
            moved_by({reach * v, -reach * u}, along.levels[k], small, one);
            for (std::size_t i = 0; i < one.size(); ++i) apart.levels[k][i] = along.levels[k][i] - one[i];
        }
        edge_map(apart.levels, small, noise, model, odds, map);
        moved_by({-reach * v, reach * u}, map, small, other);
        for (std::size_t i = 0; i < map.size(); ++i)
            map[i] = std::max(map[i] + other[i], static_cast<float>(model.hidden));
        maps.edges.push_back(pooled(map));
    }
    for (int place = 0; look && place < PLACES; ++place) {
        const LookOdds usual(look->mean[place], look->variance[place], model.look);
        for (std::size_t i = 0; i < map.size(); ++i)
            map[i] = usual({small.levels[0][i], small.levels[1][i], small.levels[2][i]});
        maps.looks.push_back(pooled(map));
    }
    return maps;
}

// (P,) mean log odds of the tabled paths.
Numbers rough_scores(const RoughMaps& maps, ConstCube paths, const EdgeModel& model) {
    const int count = paths.shape[0], samples = paths.shape[1];
    const float outside = static_cast<float>(0.5 * model.hidden);
    Numbers score(count);
    for (int p = 0; p < count; ++p) {
        const ConstMatrix path = paths.row(p);
        double sum = 0.0;
        for (int s = 0; s < samples; ++s) {
            const int before = std::max(s - 1, 0), after = std::min(s + 1, samples - 1);
            const double angle = std::atan2(path(after, 1) - path(before, 1), path(after, 0) - path(before, 0));
            const int direction = static_cast<int>(std::rint((angle / M_PI + 2.0) * DIRECTIONS_ROUGH)) % DIRECTIONS_ROUGH;
            const double u = std::rint((path(s, 0) + 0.5) / maps.factor - 0.5);
            const double v = std::rint((path(s, 1) + 0.5) / maps.factor - 0.5);
            float odds = outside;
            if (u >= 0.0 && u < maps.columns && v >= 0.0 && v < maps.rows) {
                const int at = static_cast<int>(v) * maps.columns + static_cast<int>(u);
                odds = maps.edges[direction][at];
                if (!maps.looks.empty()) odds += maps.looks[s * PLACES / samples][at];
            }
            sum += odds * (s < ROOT * samples ? 1.5 : 1.0);
        }
        score[p] = sum / samples;
    }
    return score;
}

// Log odds (S, M) of an antenna whose middle is at an offset from a path (S, 2) along its normals.
struct Strip {
    Table path, normal, odds;
    double first, step = STRIP_STEP_PX;
};

template <class T>
Strip strip_along(const Colours<T>& picture, ConstMatrix path, double width_px, double reach_px, const Look* look,
                  const Colour& noise, const EdgeModel& model, const EdgeOdds& odds_of) {
    const int stations = path.shape[0], channels = picture.coloured() ? 3 : 1;
    const int half = static_cast<int>(std::ceil(reach_px / STRIP_STEP_PX)), across = 2 * half + 1;
    const int height = picture.levels.shape[0], width = picture.levels.shape[1];
    Strip strip = {Table(path), normals(path), {}, 0.0};
    std::vector<float> levels(static_cast<std::size_t>(stations) * across * channels);
    std::vector<char> inside(static_cast<std::size_t>(stations) * across);
    for (int s = 0; s < stations; ++s)
        for (int n = 0; n < across; ++n) {
            const double far = STRIP_STEP_PX * (n - half);
            const double u = path(s, 0) + far * strip.normal(s, 0), v = path(s, 1) + far * strip.normal(s, 1);
            inside[s * across + n] = u >= 0.0 && v >= 0.0 && u <= width - 1.0 && v <= height - 1.0;
            const double x = bounded(u, 0.0, width - 1.0), y = bounded(v, 0.0, height - 1.0);
            const int left = std::min(static_cast<int>(x), std::max(width - 2, 0)), right = std::min(left + 1, width - 1);
            const int top = std::min(static_cast<int>(y), std::max(height - 2, 0)), bottom = std::min(top + 1, height - 1);
            const float a = static_cast<float>(x - left), b = static_cast<float>(y - top);
            const Colour tl = picture.at(top, left), tr = picture.at(top, right), bl = picture.at(bottom, left),
                         br = picture.at(bottom, right);
            float* const to = &levels[(static_cast<std::size_t>(s) * across + n) * channels];
            for (int k = 0; k < channels; ++k)
                to[k] = (1.0f - b) * ((1.0f - a) * tl[k] + a * tr[k]) + b * ((1.0f - a) * bl[k] + a * br[k]);
        }
    const Numbers along = arc_lengths(path);
    const double ds = std::max(along[stations - 1] / std::max(stations - 1, 1), 1e-6);
    const int near = std::max(0, static_cast<int>(std::rint(0.5 * (SMOOTHED_PX / ds - 1.0))));
    // running sums across of what is averaged along
    const int row = across * channels;
    std::vector<double> sums(static_cast<std::size_t>(stations) * (row + channels));
    std::vector<float> mean(row);
    for (int s = 0; s < stations; ++s) {
        const int from = std::max(s - near, 0), to = std::min(s + near, stations - 1);
        std::fill(mean.begin(), mean.end(), 0.0f);
        for (int t = from; t <= to; ++t)
            for (int i = 0; i < row; ++i) mean[i] += levels[static_cast<std::size_t>(t) * row + i];
        double* const own = &sums[static_cast<std::size_t>(s) * (row + channels)];
        for (int i = 0; i < row; ++i) own[i + channels] = own[i] + mean[i] / static_cast<float>(to - from + 1);
    }
    const auto mean_of = [&](int s, int k, int from, int to) {
        const double* const own = &sums[static_cast<std::size_t>(s) * (row + channels)];
        return (own[(to + 1) * channels + k] - own[from * channels + k]) / (to - from + 1);
    };
    const auto steps = [](double px) { return static_cast<int>(std::rint(px / STRIP_STEP_PX)); };
    const int gap = steps(EDGE_GAP_PX), inner = steps(EDGE_GAP_PX + std::min(0.5 * width_px, EDGE_PX));
    const int room = inner + 1, edges = across - 2 * room, wide = steps(0.5 * width_px);
    const int middles = edges - 2 * wide, core = steps(0.35 * width_px);
    strip.first = STRIP_STEP_PX * (room + wide - half);
    strip.odds = Table(stations, std::max(middles, 0));
    if (middles < 2) return strip;
    Table usual(stations, channels), apart(stations, edges * channels);
    Numbers squares(edges);
    for (int s = 0; s < stations; ++s)
        for (int k = 0; k < channels; ++k) {
            for (int e = 0; e < edges; ++e) {
                const int at = room + e;
                const double off = mean_of(s, k, at + gap, at + inner) - mean_of(s, k, at - inner, at - gap);
                apart(s, e * channels + k) = off;
                squares[e] = off * off;
            }
            usual(s, k) = quantile(squares, USUAL_QUANTILE) / USUAL_SQUARE;
        }
    const int far = std::max(1, static_cast<int>(10.0 / ds));
    Numbers edge(edges);
    for (int s = 0; s < stations; ++s) {
        Colour inverse = {}, low = {};
        const int from = std::max(s - far, 0), to = std::min(s + far, stations - 1);
        for (int k = 0; k < channels; ++k) {
            double sum = 0.0;
            for (int t = from; t <= to; ++t) sum += usual(t, k);
            const double own = noise[k] * static_cast<double>(noise[k]) / (2.0 * near + 1.0);
            const double variance = std::max(std::max(sum / (to - from + 1), own), LEAST_VARIANCE);
            const double all = variance + 2.0 * square(spread_of(model, k));
            inverse[k] = static_cast<float>(0.5 / variance - 0.5 / all);
            low[k] = static_cast<float>(0.5 * std::log(all / variance));
        }
        const float several = static_cast<float>(std::log(channels));
        for (int e = 0; e < edges; ++e) {
            float clearest = -1e9f;
            for (int k = 0; k < channels; ++k) {
                const float off = static_cast<float>(apart(s, e * channels + k));
                clearest = std::max(clearest, off * off * inverse[k] - low[k]);
            }
            edge[e] = odds_of(clearest - several);
        }
        const bool root = s < ROOT * stations;
        const double least = root ? model.hidden_root : model.hidden;
        const double place = (s + 0.5) * PLACES / stations - 0.5;
        const int p = std::min(std::max(static_cast<int>(std::floor(place)), 0), PLACES - 2);
        const float share = static_cast<float>(bounded(place - p, 0.0, 1.0));
        Colour usual_mean = {}, usual_variance = {};
        for (int k = 0; look && k < MOST_CHANNELS; ++k) {
            usual_mean[k] = (1.0f - share) * look->mean[p][k] + share * look->mean[p + 1][k];
            usual_variance[k] = (1.0f - share) * look->variance[p][k] + share * look->variance[p + 1][k];
        }
        for (int k = 0; !look && k < MOST_CHANNELS; ++k) usual_variance[k] = 1.0f;
        const LookOdds usual_look(usual_mean, usual_variance, model.look);
        for (int m = 0; m < middles; ++m) {
            const int at = room + wide + m;
            double own = edge[m] + edge[m + 2 * wide];
            if (look) {
                own = std::max(own, model.hidden);
                Colour middle = {};
                for (int k = 0; k < MOST_CHANNELS; ++k)
                    middle[k] = static_cast<float>(mean_of(s, k, at - core, at + core));
                own += usual_look(middle);
            }
            own = std::max(own, look ? 2.0 * least : least);
            strip.odds(s, m) = inside[s * across + at] ? own : 0.5 * model.hidden;
        }
    }
    return strip;
}

// Shapes about a free axis (S, 2): its headings, and how a force at a place bends them.
struct Axis {
    int count;
    double step, length;
    Point start, normal;
    Numbers cosine, sine;
};

Axis axis_of(ConstMatrix points) {
    const int count = points.shape[0];
    const Numbers along = arc_lengths(points);
    const Table across = normals(points);
    Axis axis = {count,           along[count - 1] / (count - 1), along[count - 1], {points(0, 0), points(0, 1)},
                 {across(0, 0), across(0, 1)}, Numbers(count), Numbers(count)};
    for (int s = 0; s < count; ++s) axis.cosine[s] = across(s, 1), axis.sine[s] = -across(s, 0);
    return axis;
}

// Sine and cosine of an angle of less than 2.5 rad, to 1e-6.
inline void turned(double angle, double& sine, double& cosine) {
    const double half = 0.25 * angle, q = half * half;
    const double s = half * (1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0)));
    const double c = 1.0 - q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0));
    const double s2 = 2.0 * s * c, c2 = 1.0 - 2.0 * s * s;
    sine = 2.0 * s2 * c2;
    cosine = 1.0 - 2.0 * s2 * s2;
}

// (S,) how far the direction has turned, over the turn of the tip, where a force acts at a part of the length.
Numbers turn_shares(const Axis& axis, double contact) {
    const auto share_of = [](double reach) { return reach < 1.0 ? reach * (2.0 - reach) : 1.0; };
    const double whole = share_of(1.0 / contact);
    return each(axis.count, [&](int s) { return share_of(s / ((axis.count - 1) * contact)) / whole; });
}

// (S, 2) the shape of a bend: turned as by a force at a part `contact` of its length, moved and turned at the clamp.
void bent(const Axis& axis, const Numbers& shares, const std::array<double, 4>& bend, Table& path) {
    const auto [contact, turn, offset, rotation] = bend;
    const int count = axis.count;
    double* const __restrict to = path.begin();
    for (int s = 0; s < count; ++s) {
        double sine, cosine;
        turned(rotation + turn * shares.values[s], sine, cosine);
        to[2 * s] = axis.cosine.values[s] * cosine - axis.sine.values[s] * sine;
        to[2 * s + 1] = axis.sine.values[s] * cosine + axis.cosine.values[s] * sine;
    }
    Point at = {axis.start[0] + offset * axis.normal[0], axis.start[1] + offset * axis.normal[1]};
    Point before = {to[0], to[1]};
    to[0] = at[0], to[1] = at[1];
    for (int s = 1; s < count; ++s)
        for (int i = 0; i < 2; ++i) {
            const double heading = to[2 * s + i];
            at[i] += 0.5 * axis.step * (before[i] + heading);
            before[i] = heading;
            to[2 * s + i] = at[i];
        }
}

// Log odds of a shape along a strip about another one much like it.
double along_strip(const Strip& strip, const Table& path, double hidden, double* odds) {
    const int count = path.shape[0], last = strip.odds.shape[1] - 2;
    double sum = 0.0;
    for (int s = 0; s < count; ++s) {
        const double off = (path(s, 0) - strip.path(s, 0)) * strip.normal(s, 0) +
                           (path(s, 1) - strip.path(s, 1)) * strip.normal(s, 1);
        const double place = (off - strip.first) / strip.step;
        const int m = static_cast<int>(place);
        double own = 2.0 * hidden;
        if (place >= 0.0 && m <= last)
            own = strip.odds(s, m) + (place - m) * (strip.odds(s, m + 1) - strip.odds(s, m));
        sum += own;
        if (odds) odds[s] = own;
    }
    return sum / count;
}

// The best shape near a rough path.
template <class T>
ShapeFound best_near(const Colours<T>& picture, ConstMatrix rough, const ShapeFamily& family, const Axis& axis,
                     const Look* look, const Colour& noise, const EdgeModel& model, const EdgeOdds& odds) {
    const double weight = axis.length / model.correlation_px, width = family.width_px;
    const double loose = std::min(family.clamp_px, 20.0);
    ShapeFound best;
    best.evidence = -INFINITY;
    Table path(axis.count, 2);
    const auto tried = [&](const Strip& strip, const Numbers& shares, const std::array<double, 4>& bend) {
        bent(axis, shares, bend, path);
        const double strain = bend[1] * width / (std::min(bend[0], 1.0) * axis.length) / model.strain;
        const double evidence = weight * along_strip(strip, path, model.hidden, nullptr) - 0.5 * strain * strain;
        if (evidence > best.evidence) best = {evidence, bend, {}, {}};
    };
    const auto heading = [](ConstMatrix line) {
        const int last = line.shape[0] - 1, before = std::max(last - 7, 0);
        return std::atan2(line(last, 1) - line(before, 1), line(last, 0) - line(before, 0));
    };
    // as many points as the axis has
    const Numbers rough_along = arc_lengths(rough);
    Table even(axis.count, 2);
    for (int i = 0; i < 2; ++i) {
        const Numbers values = each(rough.shape[0], [&](int k) { return rough(k, i); });
        for (int s = 0; s < axis.count; ++s)
            even(s, i) = interpolated(rough_along, values, rough_along[rough.shape[0] - 1] * s / (axis.count - 1));
    }
    const bool certain = family.clamp_px < 4.0;
    const Strip wide = strip_along(picture, even, width, 1.2 * family.spacing_px + 0.5 * width + 10.0 + (certain ? 4.0 : loose), look,
                                   noise, model, odds);
    const double turn = std::remainder(heading(even) - heading(family.axis_px), 2.0 * M_PI);
    const double fine = (certain ? 4.0 : 8.0) / axis.length;
    const int offsets = certain ? 0 : 6, rotations = certain ? 0 : 3;
    for (const double contact : family.contacts) {
        const Numbers shares = turn_shares(axis, contact);
        for (double more = -0.25; more < 0.25; more += fine)
            for (int o = -offsets; o <= offsets; ++o)
                for (int r = -rotations; r <= rotations; ++r)
                    tried(wide, shares, {contact, turn + more, offsets ? loose * o / offsets : 0.0,
                                 rotations ? family.clamp_rad * r / rotations : 0.0});
    }
    constexpr std::array<std::array<double, 3>, 2> finer = {{{1.0, 0.01, 0.02}, {0.4, 0.004, 0.0075}}};
    constexpr std::array<double, 5> nearer = {0.7, 0.85, 1.0, 1.15, 1.4};
    for (const auto& [px, rad, bend_rad] : finer) {
        const std::array<double, 4> from = best.bend;
        Table middle(axis.count, 2);
        bent(axis, turn_shares(axis, from[0]), from, middle);
        const Strip narrow = strip_along(picture, middle, width, 0.5 * width + 10.0, look, noise, model, odds);
        best.evidence = -INFINITY;
        for (const double part : nearer) {
            const double contact = bounded(from[0] * part, 0.06, 1.9);
            const Numbers shares = turn_shares(axis, contact);
            for (int t = -4; t <= 4; ++t)
                for (int o = -2; o <= 2; ++o)
                    for (int r = -2; r <= 2; ++r)
                        tried(narrow, shares, {contact, from[1] + bend_rad * t, from[2] + 0.5 * px * o, from[3] + 0.5 * rad * r});
        }
        if (&px == &finer.back()[0]) {
            bent(axis, turn_shares(axis, best.bend[0]), best.bend, path);
            best.odds = Numbers(axis.count);
            along_strip(narrow, path, model.hidden, best.odds.begin());
        }
    }
    best.path_px = path;
    return best;
}

template <class T>
std::vector<ShapeFound> likely_in(const Colours<T>& picture, const ShapeFamily& family, ConstMatrix looks,
                                  const EdgeModel& model, int most) {
    const EdgeOdds odds(model.rate);
    const Colour noise = noise_of(picture);
    const bool known = looks.shape[0] == PLACES && picture.coloured();
    const Look look = known ? look_of(looks) : Look{};
    const Look* const own = known ? &look : nullptr;
    const RoughMaps maps = rough_maps(picture, family, own, noise, model, odds);
    Numbers score = rough_scores(maps, family.paths_px, model);
    const double least = *std::min_element(score.begin(), score.end());
    for (double& each : score) each -= least;
    const double apart = 2.0 * family.spacing_px + family.width_px;
    const Axis axis = axis_of(family.axis_px);
    std::vector<ShapeFound> found;
    for (const int one : clearest_paths(score, family.paths_px, apart, most, 0.3))
        found.push_back(best_near(picture, family.paths_px.row(one), family, axis, own, noise, model, odds));
    std::stable_sort(found.begin(), found.end(),
                     [](const ShapeFound& a, const ShapeFound& b) { return a.evidence > b.evidence; });
    return found;
}

}  // namespace

std::vector<ShapeFound> likely_shapes(const Picture& picture, const ShapeFamily& family, ConstMatrix looks,
                                      const EdgeModel& model, int most) {
    return std::visit(
        [&](const auto& levels) {
            using Kind = std::remove_const_t<std::remove_pointer_t<decltype(levels.data)>>;
            return likely_in(Colours<Kind>{levels}, family, looks, model, most);
        },
        picture);
}

}  // namespace vbaa::detect
