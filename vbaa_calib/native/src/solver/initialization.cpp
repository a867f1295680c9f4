#include "solver/initialization.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "linear_algebra.hpp"
#include "solver/normal_equations.hpp"
#include "solver/prediction.hpp"
#include "solver/rig_jacobian.hpp"

namespace vbaa::solver {

namespace {

constexpr double NEAREST = 0.05;   // the grid's first distance, in antenna lengths; the last is the tip
constexpr int ROUNDS = 2;          // reweightings of the points by the residuals of the best distance
constexpr double WARM_COST = 8.0;  // a known start is taken unless another distance explains so much more
constexpr double LARGEST_LOAD =
    3.0;                        // F·l²/EI of a start: far bends ask small deflections for a force many times too large
constexpr int REST = 2 * GRID;  // the column of `crossed` with the residuals

double grid_distance(int g) { return NEAREST + (1.0 - NEAREST) * g / (GRID - 1); }

// Weighted sums of the points over the nodes, into the fit's.
void weighted_sums(Fit& free, const Array<double, 1>& weights) {
    for (Array<double, 1>* each : {&free.diagonal, &free.off_diagonal, &free.pull}) fill(each->view(), 0.0);
    for (int i = 0; i < weights.size(); ++i) {
        const int node = free.node[i];
        const double share = free.share[i], weight = weights[i];
        const double first = weight * share, second = first * share, pull = weight * free.distance[i];
        free.diagonal[node] += weight - 2.0 * first + second;
        free.diagonal[node + 1] += second;
        free.off_diagonal[node] += first - second;
        free.pull[node] += pull - pull * share;
        free.pull[node + 1] += pull * share;
    }
}

// Weighted products of COUNT of the rig's columns, from a on, with the effects of unit forces along y and z at all
// distances, and with the residuals.
template <int COUNT>
void cross(const Rig& rig, const Fit& free, Grid& grid, ConstMatrix product, int a) {
    constexpr int vectors = GRID / LANES;
    const double* bent_by = rig.unit_deflection.begin();
    Lanes y[COUNT][vectors], z[COUNT][vectors];
    double rest[COUNT];
    for (int c = 0; c < COUNT; ++c) {
        const double by_y = free.reading_columns(1, a + c), by_z = free.reading_columns(0, a + c);
        rest[c] = by_z * free.residual[0] + by_y * free.residual[1];
        for (int k = 0; k < vectors; ++k) {
            y[c][k] = by_y * load(grid.moment[0] + k * LANES);
            z[c][k] = by_z * load(grid.moment[1] + k * LANES);
        }
    }
    for (int reading = 0; free.readings > USUAL_READINGS && reading < free.readings; ++reading) {
        if (reading == END) continue;
        for (int c = 0; c < COUNT; ++c) {
            const double by = free.reading_columns(reading, a + c);
            if (reading > END) rest[c] += by * free.residual[reading];
            for (int k = 0; k < vectors; ++k) {
                y[c][k] += by * load(grid.more[0][reading] + k * LANES);
                z[c][k] += by * load(grid.more[1][reading] + k * LANES);
            }
        }
    }
    const double *image_y = &grid.image(0, 0), *image_z = &grid.image(1, 0);
    int clamp = 0;
    for (const Camera& camera : rig.cameras) {
        const double* bent_there = bent_by;
        const int first = std::exchange(clamp, clamp + NODES);
        if (!std::binary_search(camera.vectors.begin(), camera.vectors.end(), a / LANES)) continue;
        for (int j = first; j < clamp; ++j, bent_there += GRID) {
            for (int c = 0; c < COUNT; ++c) {
                rest[c] += free.columns(j, a + c) * free.pull[j];
                const double along = product(j, a + c), along_y = along * image_y[j], along_z = along * image_z[j];
                for (int k = 0; k < vectors; ++k) {
                    const Lanes bent = load(bent_there + k * LANES);
                    y[c][k] += along_y * bent;
                    z[c][k] += along_z * bent;
                }
            }
        }
    }
    for (int c = 0; c < COUNT; ++c) {
        double* row = &grid.crossed(a + c - UNKNOWNS, 0);
        for (int k = 0; k < vectors; ++k) {
            store(row + k * LANES, y[c][k]);
            store(row + GRID + k * LANES, z[c][k]);
        }
        store(row + REST, spread(0.0));
        row[REST] = rest[c];
    }
}

// Normal equations of forces along y and z at LANES distances.
struct ForceSums {
    Lanes yy, yz, zz, y, z;
};

void best_force(const Rig& rig, Grid& grid, int g, const ForceSums& sums, int lane) {
    const double prior = tip_deflection(rig, grid.distance[g]) / TIP_DEFLECTION_STD;
    const double yy = sums.yy[lane] + prior * prior, zz = sums.zz[lane] + prior * prior, yz = sums.yz[lane];
    const double y = sums.y[lane], z = sums.z[lane], inverse = 1.0 / std::max(yy * zz - yz * yz, 1e-300);
    grid.force[g][0] = (zz * y - yz * z) * inverse;
    grid.force[g][1] = (yy * z - yz * y) * inverse;
    grid.gain[g] = 0.5 * (grid.force[g][0] * y + grid.force[g][1] * z);
}

// The best forces at all distances, and the costs that they explain.
void every_force(const Rig& rig, const Fit& free, Grid& grid) {
    const double *image_y = &grid.image(0, 0), *image_z = &grid.image(1, 0);
    const double* bent_by = rig.unit_deflection.begin();
    for (int first = 0; first < GRID; first += LANES) {
        // a force along y acts about z, and one along z about y
        Lanes by_y = load(grid.moment[0] + first), by_z = load(grid.moment[1] + first);
        ForceSums sums = {by_y * by_y, spread(0.0), by_z * by_z, free.residual[1] * by_y, free.residual[0] * by_z};
        for (int reading = 0; free.readings > USUAL_READINGS && reading < free.readings; ++reading) {
            if (reading == END) continue;
            by_y = load(grid.more[0][reading] + first), by_z = load(grid.more[1][reading] + first);
            sums.yy += by_y * by_y;
            sums.yz += by_y * by_z;
            sums.zz += by_z * by_z;
            sums.y += free.residual[reading] * by_y;
            sums.z += free.residual[reading] * by_z;
        }
        for (int clamp = 0; clamp < free.nodes; clamp += NODES) {
            Lanes bent = load(bent_by + first);
            for (int k = 0; k < NODES; ++k) {
                const int j = clamp + k;
                const double y = image_y[j], z = image_z[j];
                const Lanes own = free.diagonal[j] * bent * bent, pull = free.pull[j] * bent;
                sums.y += y * pull;
                sums.z += z * pull;
                sums.yy += y * y * own;
                sums.yz += y * z * own;
                sums.zz += z * z * own;
                if (k == LAST) break;
                const double next_y = image_y[j + 1], next_z = image_z[j + 1];
                const Lanes next = load(bent_by + (k + 1) * GRID + first), mixed = free.off_diagonal[j] * bent * next;
                sums.yy += 2.0 * y * next_y * mixed;
                sums.zz += 2.0 * z * next_z * mixed;
                sums.yz += (y * next_z + next_y * z) * mixed;
                bent = next;
            }
        }
        for (int a = 0; a < grid.crossed.shape[0]; ++a) {
            const double *row = &grid.crossed(a, 0), rest = row[REST];
            by_y = load(row + first), by_z = load(row + GRID + first);
            sums.yy -= by_y * by_y;
            sums.yz -= by_y * by_z;
            sums.zz -= by_z * by_z;
            sums.y -= rest * by_y;
            sums.z -= rest * by_z;
        }
        for (int lane = 0; lane < LANES; ++lane) best_force(rig, grid, first + lane, sums, lane);
    }
}

// Displacement by the force at the best distance and the rig's likeliest steps there.
void displace(const Rig& rig, const Fit& free, int best, Work& work, Grid& grid) {
    const auto& force = grid.force[best];
    const int count = free.steps.size();
    double* steps = work.step.begin();
    for (int k = 0; k < count; ++k) {
        const double* row = &grid.crossed(k, 0);
        steps[k] = row[REST] - force[0] * row[best] - force[1] * row[GRID + best];
    }
    solve_upper(work.factor, work.scale, count, steps);
    shift_by_steps(free, UNKNOWNS, steps, count, grid.shift);
    for (int j = 0; j < free.nodes; ++j) {
        grid.shift[j] +=
            (force[0] * grid.image(0, j) + force[1] * grid.image(1, j)) * rig.unit_deflection(j % NODES, best);
    }
}

// Best forces, the cost that each explains, and the displacement by the best.
void best_forces(const Rig& rig, Fit& free, Grid& grid, Work& work) {
    weighted_sums(free, grid.weight);
    // the unknowns' own columns, which are not used, come along
    information_of_points(rig, free, work.product);
    const int size = free.size;
    int a = UNKNOWNS;
    for (; a + 2 <= size; a += 2) cross<2>(rig, free, grid, work.product, a);
    if (a < size) cross<1>(rig, free, grid, work.product, a);
    // moments only: where the antenna ends may be wrong
    const double *by_y = &free.reading_columns(0, 0), *by_z = &free.reading_columns(1, 0);
    for (a = UNKNOWNS; a < size; ++a) {
        double* row = &free.information(a, 0);
        for (int b = a; b < size; ++b) row[b] += by_y[a] * by_y[b] + by_z[a] * by_z[b];
        for (int reading = USUAL_READINGS; reading < free.readings; ++reading) {
            const double* by = &free.reading_columns(reading, 0);
            for (int b = a; b < size; ++b) row[b] += by[a] * by[b];
        }
        row[a] += 1.0;
    }
    const int steps = free.steps.size();
    factorise(free.information, UNKNOWNS, steps, 0.0, work.factor, work.scale);
    solve_many(work.factor, work.scale, steps, grid.crossed, false);
    every_force(rig, free, grid);
    int best = 0;
    for (int g = 0; g < GRID; ++g) {
        if (grid.gain[g] > grid.gain[best] || std::isnan(grid.gain[best])) best = g;
    }
    displace(rig, free, best, work, grid);
}

}  // namespace

Array<double, 2> unit_deflections(const antenna::Taper& taper) {
    Array<double, 2> found(NODES, GRID);
    for (int j = 0; j < NODES; ++j) {
        const double past = std::max(j - CONTACT, 0);
        const double along = FREE * (j - past) / CONTACT + (1.0 - FREE) * past / NODES_BEYOND;
        for (int g = 0; g < GRID; ++g) found(j, g) = antenna::deflection(taper, along, grid_distance(g));
    }
    return found;
}

void free_antenna(const Rig& rig, const Frame& frame, Fit& fit, Work& work) {
    fit.unknowns = {FREE};
    fit.scatter = 1.0;
    fill(fit.steps.view(), 0.0);
    FreeKey& known = work.known;
    if (&fit != &work.free || rig.with_tip || !known.is_of(rig, frame)) {
        predict_free(rig, frame, work.bent, fit);
        known.made = rig.made;
        std::copy_n(frame.gravity_m_s2, 3, known.gravity_m_s2);
        std::copy_n(frame.available, READINGS, known.available);
        const ClampWrench wrench = clamp_wrench(rig, frame, work.bent, 0);
        for (int reading = 0; reading < rig.readings; ++reading) {
            known.readings[reading] = read_by(rig.by_wrench[reading], wrench);
        }
        rig_jacobian(rig, frame, LINEAR, work.bent, fit);
    } else {
        for (int reading = 0; reading < rig.readings; ++reading) {
            if (reading == END) continue;
            const double off = frame.reading[reading] / rig.std[reading] - known.readings[reading];
            fit.predicted_residual[reading] = off * frame.available[reading];
        }
    }
    feet_along_chord(rig, frame, fit);
    point_residuals(rig, frame, fit);
    std::copy_n(fit.predicted_residual, READINGS, fit.residual);
}

void few_of_free(const Task& few, const Thinned& some, const Fit& free, Fit& fit) {
    const int lines = few.rig.lines(), axes = fit.steps.size() - lines;
    const auto copy = [&](ConstMatrix from, Matrix to) {
        for (int row = 0; row < to.shape[0]; ++row) {
            std::copy_n(from.row(row).data, UNKNOWNS + axes, to.row(row).data);
            std::copy_n(from.row(row).data + free.size - lines, lines, to.row(row).data + UNKNOWNS + axes);
        }
    };
    copy(free.columns, fit.columns);
    copy(free.reading_columns, fit.reading_columns);
    fit.unknowns = free.unknowns, fit.contact_m = free.contact_m, fit.scatter = 1.0;
    fit.u = free.u, fit.v = free.v, fit.depth = free.depth;
    fit.normal_u = free.normal_u, fit.normal_v = free.normal_v, fit.cubics = free.cubics;
    fill(fit.steps.view(), 0.0);
    std::copy_n(free.residual, READINGS, fit.residual);
    for (int i = 0; i < fit.points; ++i) fit.foot_m[i] = free.foot_m[some.middle(i, free.points)];
    point_residuals(few.rig, few.frame, fit);
}

// For small deflections the picture is linear in the force once the distance is known, so force and rig are profiled
// out. A force along y or z displaces the picture by one shape for all frames times `point_jacobian` of each frame, so
// that sums over nodes are matrix products with shapes.
Grid grid_search(const Rig& rig, const Frame& frame, Fit& free, double share, Work& work) {
    Grid grid;
    const int count = free.points;
    grid.shift = Array<double, 1>(Unset{}, free.nodes);
    grid.weight = Array<double, 1>(Unset{}, count);
    grid.crossed = Array<double, 2>(Unset{}, free.steps.size(), REST + LANES);
    grid.image = point_jacobian(rig, free);
    const double unit = rig.unit_load * rig.length_m;
    for (double& displacement : grid.image.view()) displacement *= unit;
    for (int g = 0; g < GRID; ++g) {
        grid.distance[g] = grid_distance(g);
        const double moment = grid.distance[g] * rig.force_unit_N * rig.length_m;
        const bool usual = rig.readings == USUAL_READINGS;
        grid.moment[0][g] = usual ? rig.by_wrench[1][5] * moment * frame.available[1] : 0.0;
        grid.moment[1][g] = usual ? -rig.by_wrench[0][4] * moment * frame.available[0] : 0.0;
        for (int reading = 0; !usual && reading < READINGS; ++reading) {
            for (int axis = 0; axis < 2; ++axis) {
                const double per_N = by_force(rig, reading, axis, grid.distance[g] * rig.length_m);
                grid.more[axis][reading][g] = per_N * rig.force_unit_N * frame.available[reading];
            }
        }
    }
    for (int i = 0; i < count; ++i) grid.weight[i] = share * free.precision[i];
    for (int round = 0; round < ROUNDS; ++round) {
        best_forces(rig, free, grid, work);
        double whole = 0.0, left = 0.0;
        for (int i = 0; i < count; ++i) {
            const double *shift = grid.shift.begin() + free.node[i], precision = share * free.precision[i];
            const double off = free.distance[i] - shift[0] - free.share[i] * (shift[1] - shift[0]);
            grid.weight[i] = precision * huber_weight(off * std::sqrt(precision));
            whole += precision, left += grid.weight[i];
        }
        constexpr double enough = 0.99;  // of their weight is left: another round would change nothing
        if (left > enough * whole) break;
    }
    return grid;
}

double largest_gain(const Grid& grid) {
    double most = -INFINITE;
    for (double gain : grid.gain) {
        if (!(gain <= most)) most = gain;
    }
    return most;
}

void limit_load(const Rig& rig, Unknowns& start) {
    const double load = std::hypot(start[1], start[2]) * load_at(rig, start[0]);
    for (int axis = 1; axis < 3; ++axis) start[axis] *= std::min(LARGEST_LOAD / std::max(load, 1e-12), 1.0);
}

void start_at(const Rig& rig, const Grid& grid, int from, int to, double part, Unknowns& start) {
    const double here = grid.distance[from], there = grid.distance[to], distance = here + part * (there - here);
    start[0] = distance, start[3] = 0.0;
    const double by_here = tip_deflection(rig, here), by_there = tip_deflection(rig, there);
    for (int axis = 0; axis < 2; ++axis) {
        // the tip's deflection changes little from one distance to the next, the force much
        const double sway = grid.force[from][axis] * by_here, sway_there = grid.force[to][axis] * by_there;
        const double force = (sway + part * (sway_there - sway)) / tip_deflection(rig, distance);
        // where no force could be fitted the free antenna is as good a start as any
        start[1 + axis] = std::isfinite(force) ? force : 0.0;
    }
    limit_load(rig, start);
}

void lowest_of_grid(const Rig& rig, const Grid& grid, Starts& starts, StartCosts& costs) {
    costs.fill(INFINITE);
    const double* gain = grid.gain;
    std::array<int, STARTS> places = {};
    for (int g = 0; g < GRID; ++g) {
        if ((g > 0 && gain[g] < gain[g - 1]) || (g < GRID - 1 && gain[g] < gain[g + 1])) continue;
        double cost = -gain[g];
        int place = g;
        for (int k = 0; k < STARTS; ++k) {
            if (cost < costs[k]) std::swap(cost, costs[k]), std::swap(place, places[k]);
        }
    }
    for (int k = 0; k < STARTS; ++k) {
        const int g = places[k];
        int next = g;
        double part = 0.0;
        if (0 < g && g < GRID - 1) {
            const double bend = 2.0 * gain[g] - gain[g - 1] - gain[g + 1];
            if (bend > 0.0) part = std::min(std::max(0.5 * (gain[g + 1] - gain[g - 1]) / bend, -0.5), 0.5);
            next = part < 0.0 ? g - 1 : g + 1;
        }
        start_at(rig, grid, g, next, std::abs(part), starts[k]);
    }
}

void warm_start(const Grid& grid, const Unknowns& warm, Starts& starts, StartCosts& costs) {
    for (double value : warm) {
        if (!std::isfinite(value)) return;
    }
    int near = 0;
    for (int g = 0; g < GRID; ++g) {
        if (std::abs(grid.distance[g] - warm[0]) < std::abs(grid.distance[near] - warm[0])) near = g;
    }
    if (!(grid.gain[near] > largest_gain(grid) - WARM_COST)) return;
    starts[0] = warm;
    std::fill(costs.begin() + 1, costs.end(), INFINITE);
}

}  // namespace vbaa::solver
