#include "detect/path_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <queue>
#include <tuple>
#include <utility>

#include "detect/evidence.hpp"

namespace vbaa::detect {
namespace {

// Directions may change by so many in a step.
constexpr int TURN = 5;
// Places reached in one search, most: 100 MB. MOST_ALONE: the same for paths that may end anywhere.
constexpr std::size_t MOST_REACHED = 4'000'000, MOST_ALONE = 80'000;
constexpr int NOWHERE = -1;
// Directions on either side of a cut one that are cut with it: more than a path can turn in one step.
constexpr int CUT = 3;

// A place and direction of a path: down or up a picture (way 1 or -1), or of the transposed one (`across`) to the right
// or left.
struct State {
    bool across;
    int way, row, direction, column;
};

struct Reached {
    std::size_t state = 0;
    int before = NOWHERE;
    float cost = 0.0F;  // evidence that the path lacks, and the cost of its turns
    float sum = 0.0F;   // evidence less turns
    float peak = 0.0F;  // most of that along the path
    bool done = false;
};

class Lattice {
  public:
    Lattice(View<const float, 3> down, View<const float, 3> across, const PathRules& rules)
        : _charts{down, across},
          _half(static_cast<std::size_t>(down.size())),
          _all(_half + static_cast<std::size_t>(across.size())),
          _rules(rules),
          _slot(2 * _all, NOWHERE),
          _taken(across.shape[2], down.shape[2]) {
        for (int k = 0; k < DIRECTIONS_DOWN; ++k) {
            _length[k] = static_cast<float>(rules.widths_per_px * ROW_STEP / std::cos(slant_of(k)));
            const double columns = ROW_STEP * std::tan(slant_of(k));
            _columns[k] = {static_cast<int>(std::floor(columns + 1e-9)), static_cast<int>(std::ceil(columns - 1e-9))};
        }
    }

    std::array<double, 2> place(const State& at) const {
        const double along = at.row * ROW_STEP + 0.5 * (ROW_STEP - 1), other = at.column;
        return at.across ? std::array{along, other} : std::array{other, along};
    }

    // Index of the end of the best path from some states to the vicinity of one of the places, or to where its evidence
    // is largest; NOWHERE if none.
    int search(const std::vector<State>& starts, ConstMatrix ends) {
        for (const Reached& each : _reached) _slot[each.state] = NOWHERE;
        _reached.clear();
        _queue = {};
        for (const State& each : starts) _reach(each, NOWHERE, 0.0F, 0.0F);
        int best = NOWHERE;
        const std::size_t most = ends.shape[0] > 0 ? MOST_REACHED : MOST_ALONE;
        while (!_queue.empty() && _reached.size() < most) {
            // that takes as long as reaching some 100,000 places
            if (ends.shape[0] > 0 && _ahead[0].empty() && _reached.size() > MOST_REACHED / 40) {
                _look_ahead(ends);
                return search(starts, ends);
            }
            const int at = _queue.top().second;
            _queue.pop();
            if (_reached[at].done) continue;
            _reached[at].done = true;
            const State state = unpack(_reached[at].state);
            if (ends.shape[0] == 0) {
                if (best == NOWHERE || _reached[at].sum > _reached[best].sum) best = at;
                if (_reached[at].sum < _reached[at].peak - _rules.drop) continue;
            } else if (_near(ends, state)) {
                _bound = std::min(_bound, _rules.slack[0] * _reached[at].cost + _rules.slack[1]);
                return at;
            }
            _go_on(state, at);
        }
        return best;
    }

    const Reached& operator[](int at) const { return _reached[at]; }

    // States of a path, from its start.
    std::vector<State> path(int at) const {
        std::vector<State> found;
        for (; at != NOWHERE; at = _reached[at].before) found.push_back(unpack(_reached[at].state));
        std::reverse(found.begin(), found.end());
        return found;
    }

    // All states near places, of which one begins a path.
    std::vector<State> near(ConstMatrix places) const {
        std::vector<State> found;
        for (const bool across : {false, true})
            for (int row = 0; row < _charts[across].shape[0]; ++row)
                for (int column = 0; column < _charts[across].shape[2]; ++column) {
                    if (!_near(places, {across, 1, row, 0, column})) continue;
                    for (int k = 0; k < DIRECTIONS_DOWN; ++k)
                        for (const int way : {-1, 1}) found.push_back({across, way, row, k, column});
                }
        return found;
    }

    // States in the midst of straight pieces with much evidence, so many steps to either side, the best first.
    std::vector<State> seeds(int steps) const {
        std::vector<std::pair<float, State>> found;
        const int cell = std::max(1, static_cast<int>(_rules.apart_px));
        for (const bool across : {false, true}) {
            const View<const float, 3>& chart = _charts[across];
            Array<float, 2> best(chart.shape[0] / 2 + 1, chart.shape[2] / cell + 1);
            Array<int, 2> which(best.shape[0], best.shape[1]);
            for (int row = steps; row < chart.shape[0] - steps; ++row)
                for (int k = 0; k < DIRECTIONS_DOWN; ++k) {
                    const double columns = ROW_STEP * std::tan(slant_of(k));
                    const int reach = static_cast<int>(std::ceil(steps * std::abs(columns)));
                    for (int x = reach; x < chart.shape[2] - reach; ++x) {
                        if (chart(row, k, x) <= 0.0F) continue;
                        float sum = 0.0F;
                        for (int by = -steps; by <= steps; ++by)
                            sum += chart(row + by, k, x + static_cast<int>(std::lrint(by * columns)));
                        if (sum > best(row / 2, x / cell)) {
                            best(row / 2, x / cell) = sum;
                            which(row / 2, x / cell) = (row % 2 * DIRECTIONS_DOWN + k) * cell + x % cell;
                        }
                    }
                }
            for (int j = 0; j < best.shape[0]; ++j)
                for (int i = 0; i < best.shape[1]; ++i)
                    if (best(j, i) > static_cast<float>(0.6 * _rules.enough * (2 * steps + 1))) {
                        const int code = which(j, i) / cell;
                        found.emplace_back(best(j, i), State{across, 1, 2 * j + code / DIRECTIONS_DOWN,
                                                             code % DIRECTIONS_DOWN, i * cell + which(j, i) % cell});
                    }
        }
        const auto order = [](const auto& each) {
            const State& at = each.second;
            return std::tuple(-each.first, at.across, at.row, at.column);
        };
        std::sort(found.begin(), found.end(), [&](const auto& a, const auto& b) { return order(a) < order(b); });
        std::vector<State> states;
        states.reserve(found.size());
        for (const auto& each : found) states.push_back(each.second);
        return states;
    }

    bool taken(const State& at) const {
        const auto [x, y] = place(at);
        return _taken(static_cast<int>(y), static_cast<int>(x)) != 0;
    }

    // Reserves the places near a path, except near ends that all paths share: no other path may use them.
    void take(const std::vector<State>& path, ConstMatrix starts, ConstMatrix ends) {
        const int reach = static_cast<int>(_rules.apart_px);
        for (const State& each : path) {
            const auto [x, y] = place(each);
            const double room = 2.0 * (_rules.tolerance_px + _rules.apart_px);
            if (_within(starts, x, y, room) || _within(ends, x, y, room)) continue;
            const int u = static_cast<int>(x), v = static_cast<int>(y);
            for (int j = std::max(0, v - reach); j <= std::min(_taken.shape[0] - 1, v + reach); ++j)
                for (int i = std::max(0, u - reach); i <= std::min(_taken.shape[1] - 1, u + reach); ++i)
                    _taken(j, i) = 1;
        }
    }

    State unpack(std::size_t packed) const {
        State at{false, packed < _all ? 1 : -1, 0, 0, 0};
        packed %= _all;
        at.across = packed >= _half;
        if (at.across) packed -= _half;
        const auto width = static_cast<std::size_t>(_charts[at.across].shape[2]);
        at.column = static_cast<int>(packed % width);
        at.direction = static_cast<int>(packed / width % DIRECTIONS_DOWN);
        at.row = static_cast<int>(packed / width / DIRECTIONS_DOWN);
        return at;
    }

    // Closes a path's weakest place to other paths in the same direction; false if there is none between its ends.
    bool cut(int at, ConstMatrix starts, ConstMatrix ends) {
        std::vector<int> path;
        for (; at != NOWHERE; at = _reached[at].before) path.push_back(at);
        constexpr int steps = 2;  // to either side
        float most = 1.0F;        // what a place lacks of full evidence, least
        const State* weakest = nullptr;
        State found{};
        for (std::size_t i = steps; i + steps < path.size(); ++i) {
            const float lacking = _reached[path[i - steps]].cost - _reached[path[i + steps]].cost;
            const State state = unpack(_reached[path[i]].state);
            const auto [x, y] = place(state);
            const double room = _rules.tolerance_px + 2.0 * _rules.apart_px;
            if (lacking <= most || _within(starts, x, y, room) || _within(ends, x, y, room)) continue;
            most = lacking;
            found = state;
            weakest = &found;
        }
        if (weakest != nullptr) _cuts.push_back(found);
        return weakest != nullptr;
    }

  private:
    // The number of a direction among all, either way.
    static int _bearing(const State& at) {
        const int slant = at.direction - (DIRECTIONS_DOWN - 1) / 2;
        return ((at.across ? slant : 16 - slant) + 64) % 32;
    }

    bool _is_cut(const State& at) const {
        for (const State& each : _cuts) {
            const int apart = std::abs(_bearing(at) - _bearing(each));
            if (std::min(apart, 32 - apart) > CUT) continue;
            const auto [x, y] = place(at);
            const auto [u, v] = place(each);
            if (std::hypot(x - u, y - v) <= 2.0 * _rules.apart_px) return true;
        }
        return false;
    }

    std::size_t _pack(const State& at) const {
        const View<const float, 3>& chart = _charts[at.across];
        const auto place = (static_cast<std::size_t>(at.row) * DIRECTIONS_DOWN + at.direction) * chart.shape[2];
        return (at.way > 0 ? 0 : _all) + (at.across ? _half : 0) + place + at.column;
    }

    static bool _within(ConstMatrix places, double x, double y, double reach) {
        for (int i = 0; i < places.shape[0]; ++i)
            if (std::hypot(places(i, 0) - x, places(i, 1) - y) <= reach) return true;
        return false;
    }

    bool _near(ConstMatrix places, const State& at) const {
        const auto [x, y] = place(at);
        return _within(places, x, y, _rules.tolerance_px + 0.5 * ROW_STEP);
    }

    // Extends a path from one state to the next: `turn` is the change of direction, `length` the share of the evidence
    // that counts.
    void _reach(const State& at, int before, float turn, float length) {
        const View<const float, 3>& chart = _charts[at.across];
        float evidence = chart(at.row, at.direction, at.column);
        if (taken(at)) evidence = std::min(evidence, -static_cast<float>(_rules.enough));
        const float sharp = std::max(0.0F, std::abs(turn) - 1.0F);
        const float less = static_cast<float>(_rules.turn_cost) * sharp * sharp;
        Reached next{_pack(at), before, less + length * _lacking(evidence), length * evidence - less, 0.0F, false};
        if (before != NOWHERE) {
            next.cost += _reached[before].cost;
            next.sum += _reached[before].sum;
            next.peak = std::max(next.sum, _reached[before].peak);
        }
        const float least = next.cost + (_ahead[0].empty() ? 0.0F : _ahead[at.across][_cell(at)]);
        if (least > _bound || _is_cut(at)) return;
        int& slot = _slot[next.state];
        if (slot == NOWHERE) {
            slot = static_cast<int>(_reached.size());
            _reached.push_back(next);
        } else if (!_reached[slot].done && next.cost < _reached[slot].cost) {
            _reached[slot] = next;
        } else {
            return;
        }
        _queue.emplace(least, slot);
    }

    std::size_t _cell(const State& at) const {
        return static_cast<std::size_t>(at.row) * _charts[at.across].shape[2] + at.column;
    }

    float _lacking(float evidence) const {
        return static_cast<float>(_rules.length_cost) + std::max(0.0F, static_cast<float>(_rules.enough) - evidence);
    }

    // Heuristic of the A* search: from each place the least cost of a path to an end if turns cost nothing; infinite
    // beyond the bound.
    void _look_ahead(ConstMatrix ends) {
        std::priority_queue<std::pair<float, std::size_t>, std::vector<std::pair<float, std::size_t>>, std::greater<>>
            queue;
        const auto come = [&](const State& at, float cost) {
            const View<const float, 3>& chart = _charts[at.across];
            if (at.row < 0 || at.row >= chart.shape[0] || at.column < 0 || at.column >= chart.shape[2]) return;
            float& known = _ahead[at.across][_cell(at)];
            if (cost >= known || cost > _bound) return;
            known = cost;
            queue.emplace(cost, _pack(at));
        };
        for (const bool across : {false, true}) {
            const auto size = static_cast<std::size_t>(_charts[across].shape[0]) * _charts[across].shape[2];
            _ahead[across].assign(size, std::numeric_limits<float>::infinity());
        }
        for (const State& each : near(ends))
            if (each.direction == 0) come(each, 0.0F);
        while (!queue.empty()) {
            const auto [cost, packed] = queue.top();
            queue.pop();
            const State at = unpack(packed);
            if (cost > _ahead[at.across][_cell(at)]) continue;
            for (int k = 0; k < DIRECTIONS_DOWN; ++k) {
                const float more = cost + _length[k] * _lacking(_charts[at.across](at.row, k, at.column));
                for (int shift = _columns[k][0]; shift <= _columns[k][1]; ++shift)
                    for (const int way : {-1, 1}) come({at.across, 1, at.row - way, 0, at.column - way * shift}, more);
            }
            // where paths at 45° enter from the other picture, and leave to it
            for (int column = at.row * ROW_STEP; column < (at.row + 1) * ROW_STEP; ++column)
                for (const int sign : {-1, 1}) {
                    const int along = at.column - ROW_STEP / 2 - sign * (at.row * ROW_STEP + ROW_STEP / 2 - column);
                    if (along >= 0 && along % ROW_STEP == 0) come({!at.across, 1, along / ROW_STEP, 0, column}, cost);
                }
        }
    }

    void _go_on(const State& from, int at) {
        const View<const float, 3>& chart = _charts[from.across];
        const int row = from.row + from.way;
        if (row >= 0 && row < chart.shape[0])
            for (int k = std::max(0, from.direction - TURN);
                 k <= std::min((DIRECTIONS_DOWN - 1), from.direction + TURN); ++k) {
                const auto [low, high] = _columns[k];
                for (int shift = low; shift <= high; ++shift) {
                    const int column = from.column + from.way * shift;
                    if (column < 0 || column >= chart.shape[2]) continue;
                    _reach({from.across, from.way, row, k, column}, at, static_cast<float>(k - from.direction),
                           _length[k]);
                }
            }
        if (from.direction % (DIRECTIONS_DOWN - 1) != 0) return;
        // at 45° the same direction exists in the transposed picture: its next row is a little further along
        const int sign = from.direction == 0 ? -1 : 1;
        const View<const float, 3>& other = _charts[!from.across];
        const int next = from.column / ROW_STEP;
        const int column = from.row * ROW_STEP + ROW_STEP / 2 + sign * (next * ROW_STEP + ROW_STEP / 2 - from.column);
        if (next < other.shape[0] && column >= 0 && column < other.shape[2])
            _reach({!from.across, sign * from.way, next, from.direction, column}, at, 0.0F, 0.0F);
    }

    using Waiting = std::pair<float, int>;

    std::array<View<const float, 3>, 2> _charts;
    std::size_t _half, _all;
    PathRules _rules;
    double _bound = _rules.bound;
    std::array<std::vector<float>, 2> _ahead;  // by row and column of either chart
    std::vector<State> _cuts;
    std::vector<int> _slot;
    Array<unsigned char, 2> _taken;
    std::array<float, DIRECTIONS_DOWN> _length = {};
    std::array<std::array<int, 2>, DIRECTIONS_DOWN> _columns = {};
    std::vector<Reached> _reached;
    std::priority_queue<Waiting, std::vector<Waiting>, std::greater<>> _queue;
};

State turned(State at) {
    at.way = -at.way;
    return at;
}

}  // namespace

std::vector<FoundPath> best_paths(View<const float, 3> down, View<const float, 3> across, ConstMatrix starts,
                                  ConstMatrix ends, const PathRules& rules) {
    Lattice lattice(down, across, rules);
    std::vector<FoundPath> found;
    const auto keep = [&](const std::vector<State>& path, double sum, double cost) {
        if (ends.shape[0] == 0) lattice.take(path, starts, ends);
        if (path.size() < 2 || sum < rules.least) return;
        FoundPath next{Array<double, 2>(static_cast<int>(path.size()), 2), sum, cost};
        for (std::size_t i = 0; i < path.size(); ++i)
            for (int axis = 0; axis < 2; ++axis) next.path_px(static_cast<int>(i), axis) = lattice.place(path[i])[axis];
        found.push_back(std::move(next));
    };
    if (starts.shape[0] > 0) {
        const std::vector<State> first = lattice.near(starts);
        bool another = false;
        while (static_cast<int>(found.size()) < rules.count) {
            const int at = lattice.search(first, ends);
            const std::size_t before = found.size();
            if (at != NOWHERE) keep(lattice.path(at), lattice[at].sum, lattice[at].cost);
            if (found.size() == before) break;
            if (ends.shape[0] == 0 || lattice.cut(at, starts, ends)) continue;
            if (another) break;
            lattice.take(lattice.path(at), starts, ends);  // another rod may run between the same ends
            another = true;
        }
        return found;
    }
    constexpr int most_seeds = 16;
    int tried = 0;
    std::vector<State> seeds = lattice.seeds(3);
    for (const State& each : lattice.seeds(1)) seeds.push_back(each);  // where a rod is short or much bent
    for (const State& seed : seeds) {
        if (static_cast<int>(found.size()) == rules.count || tried == most_seeds) break;
        if (lattice.taken(seed)) continue;
        ++tried;
        int at = lattice.search({turned(seed)}, ends);
        std::vector<State> path = lattice.path(at);
        double sum = lattice[at].sum, cost = lattice[at].cost;
        const std::array<double, 2> middle = lattice.place(seed);
        lattice.take(path, ConstMatrix(middle.data(), {1, 2}), ends);  // a ring is not twice a rod
        path.erase(path.begin());
        std::reverse(path.begin(), path.end());
        at = lattice.search({seed}, ends);
        const std::vector<State> rest = lattice.path(at);
        path.insert(path.end(), rest.begin(), rest.end());
        sum += lattice[at].sum;
        cost += lattice[at].cost;
        keep(path, sum, cost);
    }
    std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.evidence > b.evidence; });
    return found;
}

}  // namespace vbaa::detect
