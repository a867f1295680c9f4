#include "detect/rough_shapes.hpp"

#include <numeric>

namespace vbaa::detect {
namespace {

constexpr int DIRECTIONS_ROUGH = 8;
constexpr double REDUCED_WIDTH_PX = 1.6;  // least width in the reduced picture
constexpr int TILE = 8;                   // pixels of the reduced picture that are worked on together
// Of a tile's and its neighbours' squared differences: their share that a background's own make, and most that counts
constexpr double USUAL_SHARE = 0.3;
constexpr float LARGE_SQUARE = 400.0f;
constexpr float ROOT_WEIGHT = 1.5f;

// Floats that nobody has set.
using Plane = Array<float, 1>;

// A reduced picture's luma and colour differences, with more rows and columns on every side: its border's.
struct Reduced {
    int factor = 1, pool = 1;  // pixels in one; how far off a path its edges may be
    double reach = 0.0;        // from its middle, at which what is next to it is compared
    int rows = 0, columns = 0, pad = 0, stride = 0, tall = 0, channels = 0;
    Plane levels;  // (channels, tall, stride)

    float* channel(int k) { return levels.begin() + static_cast<std::ptrdiff_t>(k) * size(); }
    const float* channel(int k) const { return levels.begin() + static_cast<std::ptrdiff_t>(k) * size(); }
    int size() const { return stride * tall; }
    int at(int row, int column) const { return (row + pad) * stride + column + pad; }
};

// What moving by less than `reach` and in between takes from neighbours.
int room_of(double reach) { return static_cast<int>(std::ceil(reach)) + 1; }

// Tiles around those of the paths that are scored, and those that their differences need.
int tiles_around(int pool, double reach) { return (pool + room_of(reach) + TILE - 1) / TILE; }

Plane plane_of(const Reduced& small) { return Plane(Unset{}, small.size()); }

// Sizes of the reduced picture (height, width, channels) as the search needs it, without its levels.
Reduced reduced(std::array<int, 2> size, int channels, const RoughPaths& paths) {
    Reduced small;
    small.factor = std::max(1, static_cast<int>(paths.width_px / REDUCED_WIDTH_PX));
    small.reach = 0.5 * paths.width_px / small.factor + 1.0;
    small.rows = std::max(size[0] / small.factor, 1);
    small.columns = std::max(size[1] / small.factor, 1);
    const double pool = std::ceil(0.5 * paths.spacing_px / small.factor);
    small.pool = static_cast<int>(bounded(pool, 1.0, std::max(small.rows, small.columns)));
    small.pad = TILE * (tiles_around(small.pool, small.reach) + (small.pool + TILE - 1) / TILE + 2);
    const auto padded = [&](int count) { return 2 * small.pad + (count + TILE - 1) / TILE * TILE; };
    small.stride = padded(small.columns);
    small.tall = padded(small.rows);
    small.channels = channels;
    return small;
}

void extend(Reduced& small) {
    for (int k = 0; k < small.channels; ++k) {
        float* const plane = small.channel(k);
        for (int row = 0; row < small.rows; ++row) {
            float* const line = plane + small.at(row, 0);
            std::fill(line - small.pad, line, line[0]);
            std::fill(line + small.columns, line + small.stride - small.pad, line[small.columns - 1]);
        }
        const int below = small.tall - small.pad - small.rows;
        for (int row = 0; row < small.pad; ++row)
            std::copy_n(plane + small.at(0, -small.pad), small.stride, plane + small.at(-1 - row, -small.pad));
        for (int row = 0; row < below; ++row)
            std::copy_n(plane + small.at(small.rows - 1, -small.pad), small.stride,
                        plane + small.at(small.rows + row, -small.pad));
    }
}

// Of each row of tiles, the first one that counts and the one after the last.
struct Tiles {
    std::vector<int> from, to;

    explicit Tiles(int rows) : from(rows, 1'000'000), to(rows, 0) {}
    void add(int row, int first, int after) {
        from[row] = std::min(from[row], first);
        to[row] = std::max(to[row], after);
    }
    // Those and all within so many tiles of them.
    Tiles around(int by) const {
        const int rows = static_cast<int>(from.size());
        Tiles wider(rows);
        for (int row = 0; row < rows; ++row)
            for (int near = row - by; from[row] < to[row] && near <= row + by; ++near)
                wider.add(near, from[row] - by, to[row] + by);
        return wider;
    }
    // A function of each row of pixels, its first place in a plane, and the number of places.
    template <class Work>
    void each_row(int stride, Work&& work) const {
        for (int tile = 0; tile < static_cast<int>(from.size()); ++tile)
            for (int row = tile * TILE; from[tile] < to[tile] && row < (tile + 1) * TILE; ++row)
                work(row * stride + from[tile] * TILE, (to[tile] - from[tile]) * TILE);
    }
};

// Where a plane's values are taken from that is moved by (u, v), linear in between.
struct Moved {
    int off, stride;
    float share[4];

    Moved(double u, double v, int row_stride) : stride(row_stride) {
        const double left = std::floor(u), up = std::floor(v);
        off = static_cast<int>(up) * stride + static_cast<int>(left);
        const float x = static_cast<float>(u - left), y = static_cast<float>(v - up);
        const float shares[4] = {(1.0f - x) * (1.0f - y), x * (1.0f - y), (1.0f - x) * y, x * y};
        std::copy_n(shares, 4, share);
    }
    float operator()(const float* at) const {
        const float* const from = at + off;
        return share[0] * from[0] + share[1] * from[1] + share[2] * from[stride] + share[3] * from[stride + 1];
    }
};

// The places of paths in the reduced picture.
struct Places {
    int count, samples;
    std::vector<int> at, plain;                // (P * T) in the directions' planes, and in one
    std::vector<Tiles> of_direction, of_look;  // tiles that they reach

    int place_of(int sample) const { return sample * LOOK_PLACES / samples; }
    // All tiles that are worked on.
    Tiles seen(const Reduced& small) const {
        Tiles all(small.tall / TILE);
        for (const Tiles& one : of_look)
            for (std::size_t row = 0; row < one.from.size(); ++row)
                all.add(static_cast<int>(row), one.from[row], one.to[row]);
        return all.around(small.pad / TILE - 1);
    }
};

// The bounds between directions: 0 is along u, the others in equal steps of half a turn.
struct Bounds {
    std::array<float, DIRECTIONS_ROUGH> cosine, sine;

    Bounds() {
        for (int k = 0; k < DIRECTIONS_ROUGH; ++k) {
            const double bound = M_PI * (k + 0.5) / DIRECTIONS_ROUGH;
            cosine[k] = static_cast<float>(std::cos(bound));
            sine[k] = static_cast<float>(std::sin(bound));
        }
    }
};

// One path's samples (T,): coordinates with one more at either end, direction, place and tile.
struct Path {
    int samples;
    std::vector<float> u, v, du, dv;
    std::vector<int> direction, at, tile;

    explicit Path(int count)
        : samples(count), u(count + 2), v(count + 2), du(count), dv(count), direction(count), at(count), tile(count) {}
};

void read(ConstMatrix points, Path& path) {
    const int samples = path.samples;
    const double* const from = points.data;
    for (int s = 0; s < samples; ++s) path.u[s + 1] = static_cast<float>(from[2 * s]);
    for (int s = 0; s < samples; ++s) path.v[s + 1] = static_cast<float>(from[2 * s + 1]);
    path.u[0] = path.u[1], path.v[0] = path.v[1];
    path.u[samples + 1] = path.u[samples], path.v[samples + 1] = path.v[samples];
}

// How many bounds a path's direction is beyond.
void direct(const Bounds& bounds, Path& path) {
    const float *const u = path.u.data(), *const v = path.v.data();
    float* const __restrict du = path.du.data(), * const __restrict dv = path.dv.data();
    int* const __restrict over = path.direction.data();
    for (int s = 0; s < path.samples; ++s) {
        const float down = v[s + 2] - v[s], turned = down < 0.0f ? -1.0f : 1.0f;
        du[s] = turned * (u[s + 2] - u[s]);
        dv[s] = turned * down;
        over[s] = 0;
    }
    for (int k = 0; k < DIRECTIONS_ROUGH; ++k) {
        const float cosine = bounds.cosine[k], sine = bounds.sine[k];
        for (int s = 0; s < path.samples; ++s) over[s] += cosine * dv[s] > sine * du[s] ? 1 : 0;
    }
    for (int s = 0; s < path.samples; ++s) over[s] = over[s] == DIRECTIONS_ROUGH ? 0 : over[s];
}

// In the reduced picture, 0 beyond it.
void place(const Reduced& small, Path& path) {
    const float *const u = path.u.data() + 1, *const v = path.v.data() + 1;
    const float scale = 1.0f / static_cast<float>(small.factor);
    const float columns = static_cast<float>(small.columns), rows = static_cast<float>(small.rows);
    const int stride = small.stride, pad = small.pad, wide = stride / TILE;
    int* const __restrict at = path.at.data(), * const __restrict tile = path.tile.data();
    for (int s = 0; s < path.samples; ++s) {
        const float x = (u[s] + 0.5f) * scale, y = (v[s] + 0.5f) * scale;
        const bool inside = x >= 0.0f && y >= 0.0f && x < columns && y < rows;
        const int column = static_cast<int>(inside ? x : 0.0f) + pad, row = static_cast<int>(inside ? y : 0.0f) + pad;
        at[s] = inside ? row * stride + column : 0;
        tile[s] = inside ? row / TILE * wide + column / TILE : 0;
    }
}

// Tiles of flags, one a tile.
Tiles tiles_of(const unsigned char* flags, int rows, int columns) {
    Tiles found(rows);
    for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column)
            if (flags[row * columns + column]) found.add(row, column, column + 1);
    return found;
}

Places places_of(const Reduced& small, ConstCube paths) {
    Places found = {paths.shape[0], paths.shape[1], {}, {}, {}, {}};
    const int count = found.count, samples = found.samples;
    found.at.resize(static_cast<std::size_t>(count) * samples);
    found.plain.resize(found.at.size());
    const int rows = small.tall / TILE, columns = small.stride / TILE, tiles = rows * columns;
    std::vector<unsigned char> along(DIRECTIONS_ROUGH * tiles), look(LOOK_PLACES * tiles);
    std::vector<int> look_of(samples);
    for (int s = 0; s < samples; ++s) look_of[s] = found.place_of(s) * tiles;
    const Bounds bounds;
    Path path(samples);
    for (int p = 0; p < count; ++p) {
        read(paths.row(p), path);
        direct(bounds, path);
        place(small, path);
        const std::size_t first = static_cast<std::size_t>(p) * samples;
        for (int s = 0; s < samples; ++s) {
            const int tile = path.tile[s];
            along[path.direction[s] * tiles + tile] = 1;
            look[look_of[s] + tile] = 1;
            found.at[first + s] = path.direction[s] * small.size() + path.at[s];
            found.plain[first + s] = path.at[s];
        }
    }
    for (int d = 0; d < DIRECTIONS_ROUGH; ++d) along[d * tiles] = 0;  // beyond the picture
    for (int p = 0; p < LOOK_PLACES; ++p) look[p * tiles] = 0;
    for (int d = 0; d < DIRECTIONS_ROUGH; ++d) found.of_direction.push_back(tiles_of(&along[d * tiles], rows, columns));
    for (int p = 0; p < LOOK_PLACES; ++p) found.of_look.push_back(tiles_of(&look[p * tiles], rows, columns));
    return found;
}

// What every direction needs anew.
struct Scratch {
    Plane along, apart, map;
    std::vector<float> usual;              // of tiles: mean square of differences
    std::vector<float> rise, low, square;  // along a row

    explicit Scratch(const Reduced& small)
        : along(plane_of(small)),
          apart(plane_of(small)),
          map(plane_of(small)),
          usual(static_cast<std::size_t>(small.tall / TILE) * (small.stride / TILE)),
          rise(small.stride),
          low(small.stride),
          square(small.stride) {}
};

// Differences across a direction of what is averaged over three pixels along it.
void differences(const Reduced& small, int channel, double angle, const Tiles& tiles, Scratch& scratch) {
    const double u = std::cos(angle), v = std::sin(angle);
    const int stride = small.stride;
    const Moved ahead(u, v, stride), behind(-u, -v, stride), across(small.reach * v, -small.reach * u, stride);
    const float* const level = small.channel(channel);
    float *const along = scratch.along.begin(), *const apart = scratch.apart.begin();
    tiles.around(1).each_row(stride, [&](int first, int count) {
        const float* const from = level + first;
        float* const __restrict to = along + first;
        for (int i = 0; i < count; ++i) to[i] = (from[i] + ahead(from + i) + behind(from + i)) * (1.0f / 3.0f);
    });
    tiles.each_row(stride, [&](int first, int count) {
        const float* const from = along + first;
        float* const __restrict to = apart + first;
        for (int i = 0; i < count; ++i) to[i] = from[i] - across(from + i);
    });
}

// Mean squares of differences in each tile.
void usual_squares(const Reduced& small, const float* apart, const Tiles& tiles, Scratch& scratch) {
    const int stride = small.stride, columns = stride / TILE;
    float* const __restrict sum = scratch.square.data();
    for (int row = 0; row < static_cast<int>(tiles.from.size()); ++row) {
        const int from = tiles.from[row] * TILE, to = tiles.to[row] * TILE;
        if (from >= to) continue;
        std::fill(sum + from, sum + to, 0.0f);
        for (int v = row * TILE; v < (row + 1) * TILE; ++v) {
            const float* const own = apart + v * stride;
            for (int i = from; i < to; ++i) sum[i] += std::min(own[i] * own[i], LARGE_SQUARE);
        }
        for (int c = tiles.from[row]; c < tiles.to[row]; ++c) {
            float all = 0.0f;
            for (int i = 0; i < TILE; ++i) all += sum[c * TILE + i];
            scratch.usual[row * columns + c] = all * (1.0f / (TILE * TILE));
        }
    }
}

// The mean over a tile and those of its neighbours that are known.
double mean_near(const std::vector<float>& values, int columns, const Tiles& tiles, int row, int column) {
    double sum = 0.0;
    int several = 0;
    for (int r = std::max(row - 1, 0); r <= std::min(row + 1, static_cast<int>(tiles.from.size()) - 1); ++r)
        for (int c = std::max(column - 1, tiles.from[r]); c < std::min(column + 2, tiles.to[r]); ++c, ++several)
            sum += values[r * columns + c];
    return sum / several;
}

// The log odds at edges of one channel's differences, without a background's own: into `map`, where they are higher.
void raise_edges(const Reduced& small, int channel, double noise, const EdgeModel& model, const Tiles& tiles,
                 Scratch& scratch) {
    const float* const apart = scratch.apart.begin();
    const int stride = small.stride, columns = stride / TILE;
    usual_squares(small, apart, tiles, scratch);
    const double least = std::max(square(noise), static_cast<double>(LEAST_VARIANCE));
    float *const rise = scratch.rise.data(), *const low = scratch.low.data();
    for (int row = 0; row < static_cast<int>(tiles.from.size()); ++row) {
        const int from = tiles.from[row] * TILE, to = tiles.to[row] * TILE;
        for (int c = tiles.from[row]; c < tiles.to[row]; ++c) {
            const double usual = USUAL_SHARE * mean_near(scratch.usual, columns, tiles, row, c);
            const EdgeScale scale = edge_scale(model, channel, std::max(least, usual));
            std::fill_n(rise + c * TILE, TILE, scale.rise);
            std::fill_n(low + c * TILE, TILE, scale.low);
        }
        for (int v = row * TILE; from < to && v < (row + 1) * TILE; ++v) {
            const float* const own = apart + v * stride;
            float* const __restrict map = scratch.map.begin() + v * stride;
            if (channel == 0)
                for (int i = from; i < to; ++i) map[i] = own[i] * own[i] * rise[i] - low[i];
            else
                for (int i = from; i < to; ++i) map[i] = std::max(map[i], own[i] * own[i] * rise[i] - low[i]);
        }
    }
}

// Log odds as bytes: their step, and that of byte 0.
struct Steps {
    float low, step;

    Steps(double least, double most)
        : low(static_cast<float>(least)), step(static_cast<float>((most - least) / 255.0)) {}
    std::uint8_t operator()(float odds) const {
        const float place = (odds - low) * (1.0f / step) + 0.5f;
        return static_cast<std::uint8_t>(static_cast<int>(std::min(std::max(0.0f, place), 255.0f)));
    }
};

using Bytes = Array<std::uint8_t, 2>;

// Of two rows the higher numbers, into the first.
void raise(float* __restrict own, const float* __restrict other, int count) {
    for (int i = 0; i < count; ++i) own[i] = std::max(own[i], other[i]);
}

// Of each of some windows in a row (count + window - 1) the highest: into (count,). By ever wider windows.
void highest_along(const float* row, int window, int count, std::vector<float>& one, std::vector<float>& other) {
    std::copy_n(row, count + window - 1, one.data());
    for (int known = 1; known < window;) {
        const int more = std::min(known, window - known);
        float* const __restrict wider = other.data();
        const float *const from = one.data(), *const later = from + more;
        for (int i = 0; i < count + window - known - more; ++i) wider[i] = std::max(from[i], later[i]);
        std::swap(one, other);
        known += more;
    }
}

// The highest within a pool around each place of the tiles, of values that are known around them: as bytes.
void pooled(const Reduced& small, const Tiles& tiles, const Steps& steps, const float* values, float* high,
            std::uint8_t* to) {
    const int stride = small.stride, pool = small.pool;
    std::vector<float> one(stride), other(stride), highest(static_cast<std::size_t>(TILE) * stride);
    tiles.around((pool + TILE - 1) / TILE).each_row(stride, [&](int first, int count) {
        highest_along(values + first - pool, 2 * pool + 1, count, one, other);
        std::copy_n(one.data(), count, high + first);
    });
    // windows of neighbouring rows have most rows in common: up to the first one's last row, and from there on
    const int together = pool > 3 ? TILE : pool > 1 ? TILE / 2 : TILE / 4;
    const auto each_rows = [&](int top, int first, int count) {
        const auto row = [&](int r) { return high + (top + r) * stride + first; };
        const auto own = [&](int r) { return highest.data() + r * stride; };
        std::copy_n(row(pool), count, own(together - 1));
        for (int r = together - 1 - pool; r < pool; ++r) raise(own(together - 1), row(r), count);
        for (int r = together - 2; r >= 0; --r) {
            std::copy_n(own(r + 1), count, own(r));
            raise(own(r), row(r - pool), count);
        }
        std::copy_n(row(pool + 1), count, one.data());
        for (int r = 1; r < together; ++r) {
            raise(one.data(), row(pool + r), count);
            raise(own(r), one.data(), count);
        }
        for (int r = 0; r < together; ++r) {
            const float* const from = own(r);
            std::uint8_t* const __restrict bytes = to + (top + r) * stride + first;
            for (int i = 0; i < count; ++i) bytes[i] = steps(from[i]);
        }
    };
    for (int tile = 0; tile < static_cast<int>(tiles.from.size()); ++tile)
        for (int top = tile * TILE; tiles.from[tile] < tiles.to[tile] && top < (tile + 1) * TILE; top += together)
            each_rows(top, tiles.from[tile] * TILE, (tiles.to[tile] - tiles.from[tile]) * TILE);
}

// A picture with what its edges are judged by.
struct Edges {
    const Reduced& small;
    const Colour& noise;
    const EdgeModel& model;
    const EdgeOdds& odds;
    Scratch& scratch;
};

// Log odds of two edges of an antenna along a direction, highest within a pool.
void edges_along(const Edges& edges, double angle, const Tiles& tiles, const Steps& steps, std::uint8_t* to) {
    const Reduced& small = edges.small;
    Scratch& scratch = edges.scratch;
    const Tiles wider = tiles.around(tiles_around(small.pool, small.reach));
    for (int k = 0; k < small.channels; ++k) {
        differences(small, k, angle, wider, scratch);
        raise_edges(small, k, static_cast<double>(edges.noise[k]) / small.factor, edges.model, wider, scratch);
    }
    const float several = static_cast<float>(std::log(small.channels)), hidden = static_cast<float>(edges.model.hidden);
    float *const map = scratch.map.begin(), *const sum = scratch.along.begin();
    wider.each_row(small.stride, [&](int first, int count) { edges.odds.replace(map + first, count, several); });
    const double u = -small.reach * std::sin(angle), v = small.reach * std::cos(angle);
    const Moved other(u, v, small.stride);
    wider.each_row(small.stride, [&](int first, int count) {
        const float* const from = map + first;
        float* const __restrict own = sum + first;
        for (int i = 0; i < count; ++i) own[i] = std::max(hidden, from[i] + other(from + i));
    });
    pooled(small, tiles, steps, sum, scratch.apart.begin(), to);
}

// Log odds of the colours of a place of the antenna, highest within a pool.
void looks_at(const Reduced& small, const UsualColours& look, const Tiles& tiles, const Steps& steps, Scratch& scratch,
              std::uint8_t* to) {
    const LookOdds odds(look, small.channels);
    const Tiles wider = tiles.around(2 * ((small.pool + TILE - 1) / TILE));
    wider.each_row(small.stride, [&](int first, int count) {
        float* const __restrict own = scratch.along.begin() + first;
        std::fill_n(own, count, odds.constant);
        for (int k = 0; k < small.channels; ++k) {
            const float* const level = small.channel(k) + first;
            for (int i = 0; i < count; ++i) own[i] += odds(k, level[i]);
        }
    });
    pooled(small, tiles, steps, scratch.along.begin(), scratch.apart.begin(), to);
}

// Mean (P,) of bytes by weights (T,), where samples stand at (P * T), a sample's plane beginning at (T,).
void add_means(const Bytes& bytes, const std::vector<int>& at, const std::vector<int>& plane,
               const std::vector<float>& weight, const Steps& steps, Numbers& score) {
    const int samples = static_cast<int>(plane.size());
    const float all = std::accumulate(weight.begin(), weight.end(), 0.0f);
    const std::uint8_t* const from = bytes.begin();
    for (int p = 0; p < score.size(); ++p) {
        const int* const own = at.data() + static_cast<std::size_t>(p) * samples;
        float sum = 0.0f;
        for (int s = 0; s < samples; ++s) sum += weight[s] * static_cast<float>(from[plane[s] + own[s]]);
        score[p] += sum * steps.step + all * steps.low;
    }
}

// The picture's part that the tiles need: blocks of pixels averaged.
template <class T>
void reduce(const Colours<T>& picture, const Tiles& tiles, Reduced& small) {
    const auto [height, width, several] = picture.levels.shape;
    const int down = std::min(small.factor, height), right = std::min(small.factor, width);
    small.levels = Plane(Unset{}, small.channels * small.size());
    const float share = 1.0f / static_cast<float>(down * right);
    int first = small.columns, after = 0, top = small.rows, bottom = 0;
    for (int tile = 0; tile < static_cast<int>(tiles.from.size()); ++tile) {
        if (tiles.from[tile] >= tiles.to[tile]) continue;
        first = std::min(first, std::max(tiles.from[tile] * TILE - small.pad, 0));
        after = std::max(after, std::min(tiles.to[tile] * TILE - small.pad, small.columns));
        top = std::min(top, std::max(tile * TILE - small.pad, 0));
        bottom = std::max(bottom, std::min((tile + 1) * TILE - small.pad, small.rows));
    }
    const int used = std::max(after - first, 0) * right * several;
    std::vector<float> sum(used);
    for (int row = top; row < bottom; ++row) {
        std::fill(sum.begin(), sum.end(), 0.0f);
        for (int v = 0; v < down; ++v) {
            const T* const own = &picture.levels(row * small.factor + v, first * small.factor, 0);
            for (int i = 0; i < used; ++i) sum[i] += static_cast<float>(own[i]);
        }
        float* const to = small.channel(0) + small.at(row, first);
        for (int k = 0; k < small.channels; ++k) {
            float* const __restrict own = to + static_cast<std::ptrdiff_t>(k) * small.size();
            for (int column = 0; column < after - first; ++column) {
                const float* const from = sum.data() + column * right * several + k;
                float all = 0.0f;
                for (int u = 0; u < right; ++u) all += from[u * several];
                own[column] = share * all;
            }
        }
        picture.convert(to, small.size(), after - first);
    }
    extend(small);
}

}  // namespace

template <class T>
Numbers rough_scores(const Colours<T>& picture, const RoughPaths& paths, const Looks* looks, const Colour& noise,
                     const EdgeModel& model) {
    Reduced small = reduced({picture.levels.shape[0], picture.levels.shape[1]}, picture.channels(), paths);
    const Places places = places_of(small, paths.paths_px);
    reduce(picture, places.seen(small), small);
    const EdgeOdds odds(model.rate);
    Scratch scratch(small);
    const Edges edges = {small, noise, model, odds, scratch};
    const int size = small.size(), samples = places.samples;
    const Steps edge_steps(model.hidden, 2.0 * odds.most()), look_steps(-model.look, model.look);
    Bytes bytes(Unset{}, std::max(DIRECTIONS_ROUGH, LOOK_PLACES), size);
    std::vector<float> weight(samples);
    std::vector<int> plane(samples);
    for (int s = 0; s < samples; ++s)
        weight[s] = (s < ROOT * samples ? ROOT_WEIGHT : 1.0f) / static_cast<float>(samples);
    Numbers score(places.count);
    for (int d = 0; d < DIRECTIONS_ROUGH; ++d) {
        std::uint8_t* const own = bytes.row(d).data;
        edges_along(edges, M_PI * d / DIRECTIONS_ROUGH, places.of_direction[d], edge_steps, own);
        own[0] = edge_steps(static_cast<float>(0.5 * model.hidden));
    }
    add_means(bytes, places.at, plane, weight, edge_steps, score);
    if (!looks) return score;
    for (int p = 0; p < LOOK_PLACES; ++p) {
        std::uint8_t* const own = bytes.row(p).data;
        looks_at(small, (*looks)[p], places.of_look[p], look_steps, scratch, own);
        own[0] = look_steps(0.0f);
    }
    for (int s = 0; s < samples; ++s) plane[s] = places.place_of(s) * size;
    add_means(bytes, places.plain, plane, weight, look_steps, score);
    return score;
}

template Numbers rough_scores(const Colours<std::uint8_t>&, const RoughPaths&, const Looks*, const Colour&,
                              const EdgeModel&);
template Numbers rough_scores(const Colours<std::uint16_t>&, const RoughPaths&, const Looks*, const Colour&,
                              const EdgeModel&);
template Numbers rough_scores(const Colours<float>&, const RoughPaths&, const Looks*, const Colour&, const EdgeModel&);
template Numbers rough_scores(const Colours<double>&, const RoughPaths&, const Looks*, const Colour&, const EdgeModel&);

}  // namespace vbaa::detect
