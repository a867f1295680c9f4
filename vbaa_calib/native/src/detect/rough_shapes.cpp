#include "detect/rough_shapes.hpp"

namespace vbaa::detect {
namespace {

constexpr int DIRECTIONS_ROUGH = 8;
constexpr double REDUCED_WIDTH_PX = 1.6;  // least width in the reduced picture
constexpr int TILE = 8;                   // pixels of the reduced picture that are worked on together
// Of a tile's and its neighbours' squared differences: their share that a background's own make, and most that counts
constexpr double USUAL_SHARE = 0.3;
constexpr float LARGE_SQUARE = 400.0f;
constexpr float ROOT_WEIGHT = 1.5f;

// How far from the middle of an antenna, in the reduced picture, what lies beside it is compared.
double reach_of(double width_px, int factor) { return 0.5 * width_px / factor + 1.0; }

// What moving by less than `reach` and in between takes from neighbours.
int room_of(double reach) { return static_cast<int>(std::ceil(reach)) + 1; }

// Tiles around those of the paths whose edges count, and those that their differences need.
int tiles_around(int pool, double reach) { return (pool + room_of(reach) + TILE - 1) / TILE; }

void extend(Reduced& small) {
    for (int k = 0; k < small.channels; ++k) {
        float* const plane = small.levels[k].get();
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

    explicit Tiles(int rows) : from(rows, 1 << 20), to(rows, 0) {}
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
    std::vector<int> at;                       // (P * T) in a plane; 0, which no path reaches, beyond the picture
    std::vector<unsigned char> direction;      // (P * T)
    std::vector<Tiles> of_direction, of_look;  // tiles that they reach

    int place_of(int sample) const { return sample * LOOK_PLACES / samples; }
};

// Directions (T,) of a path whose coordinates are given: 0 is along u, the others in equal steps of half a turn.
struct Heading {
    std::array<float, DIRECTIONS_ROUGH> cosine, sine;  // of the bounds between directions

    Heading() {
        for (int k = 0; k < DIRECTIONS_ROUGH; ++k) {
            const double bound = M_PI * (k + 0.5) / DIRECTIONS_ROUGH;
            cosine[k] = static_cast<float>(std::cos(bound));
            sine[k] = static_cast<float>(std::sin(bound));
        }
    }
    int operator()(float u, float v) const {
        const float turned = v < 0.0f ? -1.0f : 1.0f;
        int over = 0;
        for (int k = 0; k < DIRECTIONS_ROUGH; ++k) over += turned * (cosine[k] * v - sine[k] * u) > 0.0f;
        return over % DIRECTIONS_ROUGH;
    }
};

// Into `at` and `direction` (T,) those of one path (T, 2).
void place_path(const Reduced& small, const Heading& heading, ConstMatrix path, int* __restrict at,
                unsigned char* __restrict direction, float* __restrict scratch) {
    const int samples = path.shape[0];
    float *const u = scratch + 1, *const v = u + samples + 2;
    for (int s = 0; s < samples; ++s) u[s] = static_cast<float>(path.data[2 * s]);
    for (int s = 0; s < samples; ++s) v[s] = static_cast<float>(path.data[2 * s + 1]);
    u[-1] = u[0], v[-1] = v[0], u[samples] = u[samples - 1], v[samples] = v[samples - 1];
    const float scale = 1.0f / static_cast<float>(small.factor);
    const float last_column = static_cast<float>(small.columns), last_row = static_cast<float>(small.rows);
    const int first = small.at(0, 0);
    for (int s = 0; s < samples; ++s) {
        // one more, so that what is cut off is below
        const float x = (u[s] + 0.5f) * scale, y = (v[s] + 0.5f) * scale;
        const bool inside = x >= 0.0f && y >= 0.0f && x < last_column && y < last_row;
        const int column = static_cast<int>(inside ? x : 0.0f), row = static_cast<int>(inside ? y : 0.0f);
        at[s] = inside ? first + row * small.stride + column : 0;
    }
    for (int s = 0; s < samples; ++s)
        direction[s] = static_cast<unsigned char>(heading(u[s + 1] - u[s - 1], v[s + 1] - v[s - 1]));
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
    found.direction.resize(found.at.size());
    const int rows = small.tall / TILE, columns = small.stride / TILE, tiles = rows * columns;
    std::vector<unsigned char> along(DIRECTIONS_ROUGH * tiles), look(LOOK_PLACES * tiles);
    std::vector<int> tile_of_row(small.tall), look_of(samples);
    for (int s = 0; s < samples; ++s) look_of[s] = found.place_of(s) * tiles;
    std::vector<float> scratch(2 * static_cast<std::size_t>(samples) + 4);
    const Heading heading;
    const unsigned stride = small.stride;
    for (int p = 0; p < count; ++p) {
        int* const at = found.at.data() + static_cast<std::size_t>(p) * samples;
        unsigned char* const direction = found.direction.data() + static_cast<std::size_t>(p) * samples;
        place_path(small, heading, paths.row(p), at, direction, scratch.data());
        for (int s = 0; s < samples; ++s) {
            if (at[s] == 0) continue;
            const unsigned row = static_cast<unsigned>(at[s]) / stride,
                           column = static_cast<unsigned>(at[s]) - row * stride;
            const int tile = static_cast<int>(row / TILE) * columns + static_cast<int>(column / TILE);
            along[direction[s] * tiles + tile] = 1;
            look[look_of[s] + tile] = 1;
        }
    }
    for (int d = 0; d < DIRECTIONS_ROUGH; ++d) found.of_direction.push_back(tiles_of(&along[d * tiles], rows, columns));
    for (int p = 0; p < LOOK_PLACES; ++p) found.of_look.push_back(tiles_of(&look[p * tiles], rows, columns));
    return found;
}

Plane plane_of(const Reduced& small) { return Plane(new float[small.size()]); }

// What every direction needs anew.
struct Scratch {
    Plane along, map, sum, high;
    std::array<Plane, MOST_CHANNELS> apart;
    std::vector<float> usual;              // of tiles and channels: mean square of differences
    std::vector<float> rise, low, square;  // along a row

    explicit Scratch(const Reduced& small)
        : along(plane_of(small)),
          map(plane_of(small)),
          sum(plane_of(small)),
          high(plane_of(small)),
          usual(static_cast<std::size_t>(small.tall / TILE) * (small.stride / TILE)),
          rise(small.stride),
          low(small.stride),
          square(small.stride) {
        for (int k = 0; k < small.channels; ++k) apart[k] = plane_of(small);
    }
};

// Differences across a direction of what is averaged over three pixels along it.
void differences(const Reduced& small, int channel, double angle, double reach, const Tiles& tiles, Scratch& scratch) {
    const double u = std::cos(angle), v = std::sin(angle);
    const int stride = small.stride;
    const Moved ahead(u, v, stride), behind(-u, -v, stride), across(reach * v, -reach * u, stride);
    const float* const level = small.levels[channel].get();
    float *const along = scratch.along.get(), *const apart = scratch.apart[channel].get();
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
    const float* const apart = scratch.apart[channel].get();
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
            float* const __restrict map = scratch.map.get() + v * stride;
            if (channel == 0)
                for (int i = from; i < to; ++i) map[i] = own[i] * own[i] * rise[i] - low[i];
            else
                for (int i = from; i < to; ++i) map[i] = std::max(map[i], own[i] * own[i] * rise[i] - low[i]);
        }
    }
}

// The highest within a pool around each place of the tiles, of values that are known around them.
void pooled(const Reduced& small, const Tiles& tiles, const float* values, float* high, float* to) {
    const int stride = small.stride, pool = small.pool;
    tiles.around((pool + TILE - 1) / TILE).each_row(stride, [&](int first, int count) {
        float* const __restrict own = high + first;
        std::copy_n(values + first, count, own);
        for (int k = -pool; k <= pool; ++k) {
            const float* const from = values + first + k;
            for (int i = 0; i < count; ++i) own[i] = std::max(own[i], from[i]);
        }
    });
    tiles.each_row(stride, [&](int first, int count) {
        float* const __restrict own = to + first;
        std::copy_n(high + first, count, own);
        for (int k = -pool; k <= pool; ++k) {
            const float* const from = high + first + k * stride;
            for (int i = 0; i < count; ++i) own[i] = std::max(own[i], from[i]);
        }
    });
}

// Log odds of two edges of an antenna along a direction, highest within a pool.
void edges_along(const Reduced& small, double angle, double reach, const Colour& noise, const EdgeModel& model,
                 const EdgeOdds& odds, const Tiles& tiles, Scratch& scratch, float* to) {
    const Tiles wider = tiles.around(tiles_around(small.pool, reach));
    for (int k = 0; k < small.channels; ++k) {
        differences(small, k, angle, reach, wider, scratch);
        raise_edges(small, k, static_cast<double>(noise[k]) / small.factor, model, wider, scratch);
    }
    const float several = static_cast<float>(std::log(small.channels)), hidden = static_cast<float>(model.hidden);
    float *const map = scratch.map.get(), *const sum = scratch.sum.get();
    wider.each_row(small.stride, [&](int first, int count) {
        for (int i = first; i < first + count; ++i) map[i] = odds(map[i] - several);
    });
    const Moved other(-reach * std::sin(angle), reach * std::cos(angle), small.stride);
    wider.each_row(small.stride, [&](int first, int count) {
        const float* const from = map + first;
        float* const __restrict own = sum + first;
        for (int i = 0; i < count; ++i) own[i] = std::max(from[i] + other(from + i), hidden);
    });
    pooled(small, tiles, sum, scratch.high.get(), to);
}

// Log odds of the colours of a place of the antenna, highest within a pool.
void looks_at(const Reduced& small, const UsualColours& look, float most, const Tiles& tiles, Scratch& scratch,
              float* to) {
    const LookOdds odds(look, small.channels);
    const Tiles wider = tiles.around(2 * ((small.pool + TILE - 1) / TILE));
    wider.each_row(small.stride, [&](int first, int count) {
        float* const __restrict own = scratch.sum.get() + first;
        std::fill_n(own, count, odds.constant);
        for (int k = 0; k < small.channels; ++k) {
            const float* const level = small.levels[k].get() + first;
            for (int i = 0; i < count; ++i) own[i] += odds(k, level[i]);
        }
        for (int i = 0; i < count; ++i) own[i] = std::min(std::max(own[i], -most), most);
    });
    pooled(small, tiles, scratch.sum.get(), scratch.high.get(), to);
}

}  // namespace

template <class T>
Reduced reduced(const Colours<T>& picture, const RoughPaths& paths) {
    const auto [height, width, several] = picture.levels.shape;
    Reduced small;
    small.factor = std::max(1, static_cast<int>(paths.width_px / REDUCED_WIDTH_PX));
    small.pool = std::max(1, static_cast<int>(std::ceil(0.5 * paths.spacing_px / small.factor)));
    const int down = std::min(small.factor, height), right = std::min(small.factor, width);
    small.rows = std::max(height / small.factor, 1);
    small.columns = std::max(width / small.factor, 1);
    const double reach = reach_of(paths.width_px, small.factor);
    small.pad = TILE * (tiles_around(small.pool, reach) + (small.pool + TILE - 1) / TILE + 2);
    const auto padded = [&](int count) { return 2 * small.pad + (count + TILE - 1) / TILE * TILE; };
    small.stride = padded(small.columns);
    small.tall = padded(small.rows);
    small.channels = picture.channels();
    for (int k = 0; k < small.channels; ++k) small.levels[k] = plane_of(small);
    const float share = 1.0f / static_cast<float>(down * right);
    const int used = small.columns * right * several;
    std::vector<float> sum(used);
    for (int row = 0; row < small.rows; ++row) {
        std::fill(sum.begin(), sum.end(), 0.0f);
        for (int v = 0; v < down; ++v) {
            const T* const own = &picture.levels(row * small.factor + v, 0, 0);
            for (int i = 0; i < used; ++i) sum[i] += static_cast<float>(own[i]);
        }
        for (int column = 0; column < small.columns; ++column) {
            Colour all = {};
            const float* own = sum.data() + static_cast<std::size_t>(column) * right * several;
            for (int u = 0; u < right; ++u, own += several)
                for (int k = 0; k < small.channels; ++k) all[k] += own[k];
            for (float& each : all) each *= share;
            const Colour found = picture.of(all);
            for (int k = 0; k < small.channels; ++k) small.levels[k][small.at(row, column)] = found[k];
        }
    }
    extend(small);
    return small;
}

template Reduced reduced(const Colours<std::uint8_t>&, const RoughPaths&);
template Reduced reduced(const Colours<std::uint16_t>&, const RoughPaths&);
template Reduced reduced(const Colours<float>&, const RoughPaths&);
template Reduced reduced(const Colours<double>&, const RoughPaths&);

Numbers rough_scores(const Reduced& picture, const RoughPaths& paths, const Looks* looks, const Colour& noise,
                     const EdgeModel& model) {
    const Places places = places_of(picture, paths.paths_px);
    const EdgeOdds odds(model.rate);
    const double reach = reach_of(paths.width_px, picture.factor);
    Scratch scratch(picture);
    const int size = picture.size(), samples = places.samples;
    const Plane edges(new float[static_cast<std::size_t>(DIRECTIONS_ROUGH) * size]);
    for (int d = 0; d < DIRECTIONS_ROUGH; ++d) {
        float* const own = edges.get() + static_cast<std::size_t>(d) * size;
        edges_along(picture, M_PI * d / DIRECTIONS_ROUGH, reach, noise, model, odds, places.of_direction[d], scratch,
                    own);
        own[0] = static_cast<float>(0.5 * model.hidden);
    }
    const Plane look(new float[looks ? static_cast<std::size_t>(LOOK_PLACES) * size : 1]);
    for (int p = 0; looks && p < LOOK_PLACES; ++p) {
        float* const own = look.get() + static_cast<std::size_t>(p) * size;
        looks_at(picture, (*looks)[p], static_cast<float>(model.look), places.of_look[p], scratch, own);
        own[0] = 0.0f;
    }
    std::vector<float> weight(samples);
    std::vector<int> look_at(samples);
    for (int s = 0; s < samples; ++s) {
        weight[s] = (s < ROOT * samples ? ROOT_WEIGHT : 1.0f) / static_cast<float>(samples);
        look_at[s] = places.place_of(s) * size;
    }
    return each(places.count, [&](int p) {
        const int* const at = places.at.data() + static_cast<std::size_t>(p) * samples;
        const unsigned char* const direction = places.direction.data() + static_cast<std::size_t>(p) * samples;
        float sum = 0.0f;
        for (int s = 0; s < samples; ++s) sum += weight[s] * edges[direction[s] * size + at[s]];
        for (int s = 0; looks && s < samples; ++s) sum += weight[s] * look[look_at[s] + at[s]];
        return static_cast<double>(sum);
    });
}

}  // namespace vbaa::detect
