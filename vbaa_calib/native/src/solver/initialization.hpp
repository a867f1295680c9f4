// Where to begin: for each distance on a grid, the best force and the cost it explains, for small deflections.
#pragma once

#include "solver/frames.hpp"

namespace vbaa::solver {

using Starts = std::array<Unknowns, STARTS>;
using StartCosts = std::array<double, STARTS>;

// The free antenna, with the rig's derivatives for small deflections, and the points' residuals from it.
void free_antenna(const Rig& rig, const Frame& frame, Fit& fit, Work& work);

// Deflections (NODES, GRID) of the free antenna's nodes by unit forces at all distances of the grid.
Array<double, 2> unit_deflections(const antenna::Taper& taper);

// The free antenna to a few of the points, on a rig with the first of the axes, from that to all of them.
void few_of_free(const Task& few, const Thinned& some, const Fit& free, Fit& fit);

// The best force at each distance of the grid, from the points' residuals from the free antenna; they count by a share
// of their precision.
Grid grid_search(const Rig& rig, const Frame& frame, Fit& free, double share, Work& work);

// The largest decrease of the cost by any force of the grid.
double largest_gain(const Grid& grid);

// Reduce the force of a start that is too large to be one for large deflections.
void limit_load(const Rig& rig, Unknowns& start);

// Unknowns at a part of the way from one distance of the grid to another, the force within `limit_load`.
void start_at(const Rig& rig, const Grid& grid, int from, int to, double part, Unknowns& start);

// Unknowns at the lowest local minima over the grid, lowest first, and their costs, else infinite.
void lowest_of_grid(const Rig& rig, const Grid& grid, Starts& starts, StartCosts& costs);

// A known start alone, where no other distance explains the frame much better; `warm` may be NaN.
void warm_start(const Grid& grid, const Unknowns& warm, Starts& starts, StartCosts& costs);

}  // namespace vbaa::solver
