#include "solver/alternative_minima.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "order.hpp"
#include "solver/convergence.hpp"
#include "solver/initialization.hpp"
#include "solver/normal_equations.hpp"
#include "solver/prediction.hpp"

namespace vbaa::solver {
namespace {

// Contacts closer than this, in antenna lengths and in parts of the force, are taken for the same.
constexpr double SAME_DISTANCE = 1e-2, SAME_FORCE = 0.05;
// Parts of the force along the line of sight that lead to the mirror image, and to the least force.
constexpr double MIRRORED[] = {-2.0, -1.0};
// Deflections of the tip along the line of sight, in antenna lengths, from which other contacts are searched.
constexpr double LARGE_DEFLECTIONS[] = {0.1, 0.3, -0.1, -0.3};
// Largest error of a point: in parts of the antenna's length, in σ of its noise, and in σ of the rig's errors there.
constexpr double OF_LENGTH = 0.005, OF_NOISE = 30.0, OF_RIG = 6.0;
// Largest shares of a frame's points that lie near the antenna by chance, or out of its reach by mistake.
constexpr double NEAR = 0.4, BEYOND = 0.15;
// The search for the nearest shape starts at every sixth distance of the grid; iterations of each start; how many of
// them continue, and for how many more.
constexpr int APART = 6, FIRST = 5, GO_ON = 3, MORE = 15;
// Least share of a reading's variance that its noise leaves once the reading's own information is removed.
constexpr double SMALLEST_SHARE = 1e-6;
// Moments that differ by fewer σ do not distinguish a contact from its mirror image.
constexpr double DISTINGUISHABLE = 5.0;

// Whether another camera's picture shows so much more force along the line of sight, as a reading does: where the
// two contacts are farthest apart.
bool camera_distinguishes(const Rig& rig, const Frame& frame, const Fit& fit, double more) {
    if (rig.cameras.size() == 1 || frame.count == 0) return false;
    const Array<double, 2> image = point_jacobian(rig, fit);
    const double sway_m = more * rig.unit_load * rig.length_m;
    const auto& to_camera = rig.cameras[frame.seen_by].to_camera;
    double largest = 0.0;
    for (int i = 0; i < fit.points; ++i) {
        const int clamp = frame.clamp[i], j = fit.node[i];
        if (clamp == frame.seen_by * NODES) continue;
        const double place = arclength_of_node(fit, rig.length_m, j - clamp) / rig.length_m;
        const double across = to_camera[0] * image(0, j) + to_camera[1] * image(1, j);
        const double change = sway_m * across * antenna::deflection(rig.taper, place, fit.unknowns[0]);
        double variance = 1.0 / fit.precision[i];
        for (int k = UNKNOWNS; k < fit.size; ++k) variance += fit.columns(j, k) * fit.columns(j, k);
        largest = std::max(largest, change * change / variance);
    }
    return largest > DISTINGUISHABLE * DISTINGUISHABLE;
}

}  // namespace

double along_sight(const Rig& rig, const Frame& frame, const Unknowns& unknowns) {
    const auto& to_camera = rig.cameras[frame.seen_by].to_camera;
    return unknowns[1] * to_camera[0] + unknowns[2] * to_camera[1];
}

bool rough_minimum(const Task& few, const Unknowns& start, bool with_feet, Fit& rough) {
    few.work.most = few.work.evaluations + MOST_EVALUATIONS;
    rough.unknowns = start;
    coarse_minimum(few, rough, with_feet, 1.0, COARSE_ITERATIONS);
    return rough.cost == rough.cost;
}

void try_start(const Task& task, const Unknowns& start, const Fit* rough, Fit& best, Alternative& other) {
    Fit& found = task.work.found;
    found.unknowns = start;
    converge(task, rough, found, false);
    const double own = unscaled_cost(task.rig, best), cost = unscaled_cost(task.rig, found);
    const bool better = found.converged && (cost < own || !best.converged);
    const double loser = better ? own : cost;
    if (best.converged && found.converged && different(best.unknowns, found.unknowns) && loser < other.cost) {
        other = {better ? best.unknowns : found.unknowns, loser};
    }
    if (better) best = found;
}

bool different(const Unknowns& first, const Unknowns& second) {
    const double gap = std::hypot(first[1] - second[1], first[2] - second[2]);
    return std::abs(first[0] - second[0]) > SAME_DISTANCE || gap > SAME_FORCE * std::hypot(first[1], first[2]);
}

double most_distance(const Rig& rig, const Frame& frame, const Fit& fit, int every, ConstVector shift) {
    const int count = (frame.count + every - 1) / every;
    std::vector<double> square(count);
    for (int k = 0; k < count; ++k) {
        const int i = k * every, node = fit.node[i];
        const double foot = fit.foot_m[i];
        const double across = fit.distance[i] - shift[node] - fit.share[i] * (shift[node + 1] - shift[node]);
        double along = 0.0;
        if (!(0.0 < foot && foot < rig.length_m)) {
            const int end = frame.clamp[i] + (foot <= 0.0 ? 0 : LAST);
            along = (frame.u()[i] - fit.u[end]) * fit.normal_v[end] - (frame.v()[i] - fit.v[end]) * fit.normal_u[end];
        }
        square[k] = across * across + along * along;
    }
    return std::sqrt(nth_smallest(square, static_cast<int>(NEAR * count)));
}

double beyond_reach(const Rig& rig, const Frame& frame) {
    std::vector<double> square(frame.count);  // of the rays' distances from the clamp
    double away = 1.0;
    for (int i = 0; i < frame.count; ++i) {
        const auto& [x, y, z] = rig.cameras[frame.clamp[i] / NODES].translation_m;
        const double u = frame.u()[i], v = frame.v()[i], a = y - z * v, b = z * u - x, c = x * v - y * u;
        away = x * x + y * y + z * z;
        square[i] = (a * a + b * b + c * c) / (1.0 + u * u + v * v);
    }
    const int last = frame.count - 1 - static_cast<int>(BEYOND * frame.count);
    return (std::sqrt(nth_smallest(square, last)) - rig.length_m) / std::sqrt(away);
}

LargestError largest_error(const Rig& rig, const Fit& free, int every) {
    const int count = (free.points + every - 1) / every;
    double square = 0.0, noise = 0.0, depth = free.depth[CONTACT];
    for (int clamp = 0; clamp < free.nodes; clamp += NODES) {
        double own = 0.0;
        for (int j = clamp; j < clamp + NODES; ++j) {
            for (int k = UNKNOWNS; k < free.size; ++k) own += free.columns(j, k) * free.columns(j, k);
        }
        square = std::max(square, own), depth = std::min(depth, free.depth[clamp + CONTACT]);
    }
    for (int k = 0; k < count; ++k) noise += 1.0 / std::sqrt(free.precision[k * every]);
    noise /= count;
    const double of_length = OF_LENGTH * rig.length_m / depth;
    const double far = std::max(std::max(of_length, OF_NOISE * noise), OF_RIG * std::sqrt(square / NODES));
    return {far, far / noise * std::sqrt(every)};
}

double nearest_shape(const Rig& exact, Frame frame, const Grid& grid, const Unknowns& start, LargestError error,
                     Unknowns& nearest) {
    constexpr int COUNT = 2 + GRID / APART;
    constexpr double NEVER = std::numeric_limits<double>::infinity();
    Work work(exact, frame.count);
    const Array<double, 1> unmoved(exact.nodes());
    Fit& fit = work.best;
    std::array<Unknowns, COUNT> starts = {start, {start[0], 0.0, 0.0, 0.0}};  // the second is the free antenna
    for (int k = 2; k < COUNT; ++k) {
        const int g = (k - 1) * APART - 1;
        start_at(exact, grid, g, g, 0.0, starts[k]);
    }
    std::array<double, COUNT> lefts = {};
    double least = NEVER;
    for (int turn = 0; turn < COUNT + GO_ON; ++turn) {
        const bool again = turn >= COUNT;
        const int k = again ? static_cast<int>(std::min_element(lefts.begin(), lefts.end()) - lefts.begin()) : turn;
        fit.unknowns = starts[k];
        if (turn == 1) std::fill_n(frame.available, READINGS, 0.0);
        coarse_minimum({exact, frame, ELASTICA, work}, fit, false, error.scatter, again ? MORE : FIRST);
        const double left = most_distance(exact, frame, fit, 1, unmoved);
        starts[k] = fit.unknowns;
        lefts[k] = again || left != left ? NEVER : left;
        if (left < least || turn == 0) {
            least = left;
            nearest = fit.unknowns;
        }
        if (least <= error.far) break;
    }
    return least;
}

// Variance of a reading as the rest of the data predicts it where the force along the line of sight is known: the other
// unknowns of a mirror image can shift the reading by that much. variance: of the reading itself.
double predicted_variance(const Rig& rig, const Frame& frame, const Fit& fit, const Uncertainty& found, int reading,
                          double variance) {
    const auto& to_camera = rig.cameras[frame.seen_by].to_camera;
    const double sight[UNKNOWNS] = {0.0, to_camera[0], to_camera[1], 0.0};
    double own = 0.0, cross = 0.0, along = 0.0;
    for (int a = 0; a < UNKNOWNS; ++a) {
        for (int b = 0; b < UNKNOWNS; ++b) {
            const double by_a = fit.reading_columns(reading, a), by_b = fit.reading_columns(reading, b);
            own += by_a * found.covariance[a][b] * by_b;
            cross += by_a * found.covariance[a][b] * sight[b];
            along += sight[a] * found.covariance[a][b] * sight[b];
        }
    }
    const double with_reading = own - cross * cross / along;
    return with_reading / std::max(1.0 - with_reading / variance, SMALLEST_SHARE);
}

bool looks_alike(const Rig& rig, const Frame& frame, const Fit& fit, const Uncertainty& found, double more) {
    if (camera_distinguishes(rig, frame, fit, more)) return false;
    const auto& to_camera = rig.cameras[frame.seen_by].to_camera;
    const double distance_m = rig.length_m * fit.unknowns[0];
    for (int reading = 0; reading < rig.readings; ++reading) {
        if (reading == END) continue;
        double response = 0.0;
        for (int axis = 0; axis < 2; ++axis) {
            response += rig.force_unit_N * by_force(rig, reading, axis, distance_m) * to_camera[axis];
        }
        double variance = 1.0;  // noise and calibration
        for (int k = UNKNOWNS; k < fit.size; ++k) {
            variance += fit.reading_columns(reading, k) * fit.reading_columns(reading, k);
        }
        variance += predicted_variance(rig, frame, fit, found, reading, variance);
        const double change = std::abs(response * more) * frame.available[reading];
        if (!(change / std::sqrt(variance) < DISTINGUISHABLE)) return false;
    }
    return true;
}

bool mirror_ambiguous(const Rig& rig, const Frame& frame, const Fit& fit, const Uncertainty& found) {
    return looks_alike(rig, frame, fit, found, 2.0 * along_sight(rig, frame, fit.unknowns));
}

void try_mirrors(const Task& task, const Task& few, const Uncertainty& found, Fit& best, Alternative& other) {
    const Rig& rig = task.rig;
    Fit& rough = few.work.other;
    const Unknowns unknowns = best.unknowns;
    const auto& to_camera = rig.cameras[task.frame.seen_by].to_camera;
    const double along = along_sight(rig, task.frame, unknowns), sway = tip_deflection(rig, unknowns[0]);
    std::vector<double> parts;
    for (double part : MIRRORED) parts.push_back(part * along);
    for (double large : LARGE_DEFLECTIONS) parts.push_back(large / sway - along);
    const auto distinct = [&](double part) { return !looks_alike(rig, task.frame, best, found, part); };
    parts.erase(std::remove_if(parts.begin(), parts.end(), distinct), parts.end());
    for (double part : parts) {
        Unknowns start = unknowns;
        for (int axis = 0; axis < 2; ++axis) start[1 + axis] += part * to_camera[axis];
        if (!different(best.unknowns, start)) continue;
        const bool known = rough_minimum(few, start, false, rough);
        if (known && !different(best.unknowns, rough.unknowns)) continue;
        try_start(task, known ? rough.unknowns : start, known ? &rough : nullptr, best, other);
    }
}

}  // namespace vbaa::solver
