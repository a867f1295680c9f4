#include "detect/path_search.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <utility>

#include "detect/evidence.hpp"

namespace vbaa::detect {
namespace {

constexpr float NEVER = -1e6F;
// Directions may change by so many in a step.
constexpr int TURN = 3;
// Ends that are tried, from the best downwards, at most.
constexpr int TRIED = 4000;

// Where a path comes from, packed: change of direction, and which of two columns; or nowhere.
using Step = std::uint8_t;
constexpr Step NOWHERE = 255;
constexpr int COLUMN_BIT = 16;

bool near(ConstMatrix places, double x, double y, double tolerance) {
    for (int i = 0; i < places.shape[0]; ++i)
        if (std::hypot(places(i, 0) - x, places(i, 1) - y) <= tolerance) return true;
    return false;
}

// The middle of a step's last row.
double row_px(int row) { return row * ROW_STEP + ROW_STEP - 1.0; }

struct Place {
    int row, direction, column;
};

class Sweep {
  public:
    Sweep(View<const float, 3> evidence, ConstMatrix starts, const PathRules& rules)
        : _value(evidence.shape[0], evidence.shape[1], evidence.shape[2]),
          _step(evidence.shape[0], evidence.shape[1], evidence.shape[2]) {
        const int width = evidence.shape[2];
        Array<float, 1> turned(width), first(width);
        Array<std::uint8_t, 1> turn(width);
        for (int row = 0; row < evidence.shape[0]; ++row) {
            for (int x = 0; x < width; ++x) {
                const bool may = starts.shape[0] == 0 ||
                                 near(starts, x, row_px(row) - 0.5 * ROW_STEP, rules.tolerance_px + 0.5 * ROW_STEP);
                first[x] = may ? 0.0F : NEVER;
            }
            for (int k = 0; k < DIRECTIONS_DOWN; ++k) {
                const double slant = std::cos((k - 0.5 * (DIRECTIONS_DOWN - 1)) * DIRECTION_STEP);
                const auto length = static_cast<float>(rules.widths_per_step / slant);
                float* __restrict value = &_value(row, k, 0);
                Step* __restrict step = &_step(row, k, 0);
                std::copy(first.begin(), first.end(), value);
                std::fill(step, step + width, NOWHERE);
                if (row > 0) {
                    _turn(row - 1, k, static_cast<float>(rules.turn_cost), turned.begin(), turn.begin());
                    const double back = columns_of(k);
                    const int low = static_cast<int>(std::floor(back + 1e-9)),
                              high = static_cast<int>(std::ceil(back - 1e-9));
                    for (const int shift : {low, high}) {
                        const int from = std::max(0, shift), to = std::min(width, width + shift);
                        const int column = shift == low ? 0 : COLUMN_BIT;
                        for (int x = from; x < to; ++x) {
                            const float other = turned[x - shift];
                            if (other > value[x]) {
                                value[x] = other;
                                step[x] = static_cast<Step>(turn[x - shift] + column);
                            }
                        }
                    }
                }
                const float* here = &evidence(row, k, 0);
                for (int x = 0; x < width; ++x) value[x] = std::max(value[x] + length * here[x], NEVER);
            }
        }
    }

    float value(const Place& place) const { return _value(place.row, place.direction, place.column); }

    // The place before one on its path; false at the path's beginning.
    bool back(Place& place) const {
        const Step step = _step(place.row, place.direction, place.column);
        if (step == NOWHERE) return false;
        const double columns = columns_of(place.direction);
        const bool high = step >= COLUMN_BIT;
        place.column -= static_cast<int>(high ? std::ceil(columns - 1e-9) : std::floor(columns + 1e-9));
        place.direction += static_cast<int>(step % COLUMN_BIT) - TURN;
        place.row -= 1;
        return true;
    }

  private:
    // For each column of a row the best value from which a path goes on in a direction, and by which change.
    void _turn(int row, int direction, float cost, float* __restrict best, std::uint8_t* __restrict change) const {
        const int width = _value.shape[2];
        const float* same = &_value(row, direction, 0);
        for (int x = 0; x < width; ++x) best[x] = same[x];
        std::fill(change, change + width, static_cast<std::uint8_t>(TURN));
        for (int by = -TURN; by <= TURN; ++by) {
            const int other = direction + by;
            if (by == 0 || other < 0 || other >= DIRECTIONS_DOWN) continue;
            const float* from = &_value(row, other, 0);
            const float less = cost * static_cast<float>(by * by);
            const auto code = static_cast<std::uint8_t>(by + TURN);
            for (int x = 0; x < width; ++x) {
                const float each = from[x] - less;
                change[x] = each > best[x] ? code : change[x];
                best[x] = std::max(best[x], each);
            }
        }
    }

    Array<float, 3> _value;
    Array<Step, 3> _step;
};

// The best direction of each place (row, column) at which a path may end, best places first.
std::vector<Place> ends_of(const Sweep& sweep, View<const float, 3> evidence, ConstMatrix ends,
                           const PathRules& rules) {
    std::vector<std::pair<float, Place>> found;
    for (int row = 0; row < evidence.shape[0]; ++row) {
        for (int x = 0; x < evidence.shape[2]; ++x) {
            if (ends.shape[0] > 0 && !near(ends, x, row_px(row), rules.tolerance_px + 0.5 * ROW_STEP)) continue;
            Place best{row, 0, x};
            for (int k = 1; k < DIRECTIONS_DOWN; ++k)
                if (sweep.value({row, k, x}) > sweep.value(best)) best.direction = k;
            if (sweep.value(best) > rules.least) found.emplace_back(sweep.value(best), best);
        }
    }
    const auto better = [](const auto& one, const auto& other) { return one.first > other.first; };
    std::sort(found.begin(), found.end(), better);
    std::vector<Place> places;
    places.reserve(found.size());
    for (const auto& each : found) places.push_back(each.second);
    return places;
}

}  // namespace

std::vector<FoundPath> best_paths(View<const float, 3> evidence, ConstMatrix starts, ConstMatrix ends,
                                  const PathRules& rules) {
    const Sweep sweep(evidence, starts, rules);
    const int rows = evidence.shape[0], width = evidence.shape[2];
    Array<unsigned char, 2> taken(rows, width);
    const auto claim = [&](const Place& place) {
        const int reach = static_cast<int>(rules.apart_px), down = std::max(1, reach / ROW_STEP);
        for (int row = std::max(0, place.row - down); row <= std::min(rows - 1, place.row + down); ++row)
            for (int x = std::max(0, place.column - reach); x <= std::min(width - 1, place.column + reach); ++x)
                taken(row, x) = 1;
    };
    std::vector<FoundPath> found;
    int tried = 0;
    for (const Place& end : ends_of(sweep, evidence, ends, rules)) {
        if (static_cast<int>(found.size()) == rules.most || tried == TRIED) break;
        if (taken(end.row, end.column) != 0) continue;
        ++tried;
        std::vector<Place> path{end};
        for (Place place = end; sweep.back(place);) path.push_back(place);
        const auto used = std::count_if(path.begin(), path.end(),
                                        [&](const Place& each) { return taken(each.row, each.column) != 0; });
        claim(end);
        if (2 * used > static_cast<int>(path.size()) || path.size() < 2) continue;
        FoundPath next{Array<double, 2>(static_cast<int>(path.size()) + 1, 2), sweep.value(end)};
        for (std::size_t i = 0; i < path.size(); ++i) {
            const int at = static_cast<int>(path.size() - i);
            next.path_px(at, 0) = path[i].column;
            next.path_px(at, 1) = row_px(path[i].row);
        }
        // the first step begins a row before its end
        next.path_px(0, 0) = path.back().column - columns_of(path.back().direction);
        next.path_px(0, 1) = row_px(path.back().row) - ROW_STEP;
        for (const Place& each : path) claim(each);
        found.push_back(std::move(next));
    }
    return found;
}

}  // namespace vbaa::detect
