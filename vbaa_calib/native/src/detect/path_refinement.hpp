// A rough path moved onto the antenna: the best place across it, column by column, and a smooth curve through these.
#pragma once

#include "detect/picture.hpp"

namespace vbaa::detect {

// Points and spacing of the curves that are tried.
constexpr int CURVE_POINTS = 60;
constexpr double CURVE_STEP_PX = 2.0;

// Curves that are tried across a strip of 2·reach + 1 rows.
struct Curves {
    int reach;                    // px
    Array<double, 2> curves;      // (C, CURVE_POINTS) px
    Array<std::int16_t, 2> rows;  // the same as indices of rows
    Array<double, 1> bent;        // (C,) how bent each is: 0 straight, 1 most
    Array<double, 2> finer;       // (F, CURVE_POINTS) px that are added to the best

    Curves(int reach, ConstMatrix curves, ConstVector bent, ConstMatrix finer);
};

// A path that follows a ridge.
struct RefinedPath {
    Array<double, 2> path_px;         // (K, 2); none where the rough path has no two columns
    double share = 0.0;               // of the path along which there is a ridge
    double strength = 0.0;            // median height of the ridge where there is one, grey levels
    Array<double, 2> other_px{0, 2};  // (K, 2) another path, nearly as clear, that leaves this one, if there is one
    double clear = 0.0;               // how clearly the antenna shows along it, where its polarity changes
};

// The antenna's usual grey level, and its standard deviation.
struct Level {
    double usual, spread;
};

// At a share of the way from clamp to tip, of levels (L, 2) at places, L ≥ 2.
Level usual_level(ConstMatrix levels, double share);

// Along what is brighter (sign 1) or darker (−1) than both flanks, at most `reach_px` off a path (K, 2).
RefinedPath refine_path(const Picture& picture, ConstMatrix path_px, double width_px, double reach_px, double sign);

// Along what differs from its flanks, be it here brighter, there darker, or with a highlight at its side; or along what
// is as bright as the antenna, levels (L, 2), L = 0 or L ≥ 2, between other things.
RefinedPath refine_changing_path(const Picture& picture, ConstMatrix path_px, double width_px, const Curves& tried,
                                 ConstMatrix levels);

}  // namespace vbaa::detect
