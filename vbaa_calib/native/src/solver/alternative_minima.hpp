// Other contacts that explain the same frame: searched, compared, and remembered.
#pragma once

#include "solver/structs.hpp"

namespace vbaa::solver {

// The next best of a frame's different minima: its unknowns, and its cost with the σ that the points came with.
struct Alternative {
    Unknowns unknowns;
    double cost;
};

// The rough minimum reached from unknowns by a few of the points, with feet near the right ones if known; false without
// one.
bool rough_minimum(const Task& few, const Unknowns& start, bool with_feet, Fit& rough);

// Fits a frame from another start, and from a rough fit if that is there: the better fit is kept, the next best
// remembered if it is different.
void try_start(const Task& task, const Unknowns& start, const Fit* rough, Fit& best, Alternative& other);

// Whether two sets of unknowns are different contacts.
bool different(const Unknowns& first, const Unknowns& second);

// Distance, in the ideal picture, that most of every n-th point have at least from the fit's curve, which is displaced
// along its normals (M,); beyond its ends from them.
double most_distance(const Rig& rig, const Frame& frame, const Fit& fit, int every, ConstVector shift);

// Smallest distance, in the ideal picture, by which the rays of many of the points pass beyond the antenna's reach.
double beyond_reach(const Rig& rig, const Frame& frame);

// Largest distance, in the ideal picture, of the antenna's points from a rough fit by noise, rig and rung, and the
// same in the σ of means of every n points.
struct LargestError {
    double far, scatter;
};
LargestError largest_error(const Rig& rig, const Fit& free, int every);

// Distance, in the ideal picture, of most of a frame's points from the nearest antenna of any contact; the search
// ends below `far`. Leaves the unknowns in `nearest`. It uses a few of the points, with `scatter` times their noise,
// and the rig as exactly known: a tenth of a fit's work for each iteration. From the initial unknowns it uses the
// readings, then the picture alone; the best of the starts continue.
double nearest_shape(const Rig& exact, Frame frame, const Grid& grid, const Unknowns& start, LargestError error,
                     Unknowns& nearest);

// The part of a force along the line of sight of the first camera that sees anything.
double along_sight(const Rig& rig, const Frame& frame, const Unknowns& unknowns);

// Whether neither moments nor another camera distinguish the contact from one with so much more force along the line of
// sight.
bool looks_alike(const Rig& rig, const Frame& frame, const Fit& fit, const Uncertainty& found, double more);

// Whether they do not distinguish it from its mirror image.
//
// The mirror is the plane through the antenna's x axis across the line of sight: small deflections before and behind
// it look alike, but for perspective.
bool mirror_ambiguous(const Rig& rig, const Frame& frame, const Fit& fit, const Uncertainty& found);

// Fits from contacts that may look like the best one, of this uncertainty: the mirror image, the least force that the
// picture asks for, and forces that bend the antenna far before and behind the mirror.
void try_mirrors(const Task& task, const Task& few, const Uncertainty& found, Fit& best, Alternative& other);

}  // namespace vbaa::solver
