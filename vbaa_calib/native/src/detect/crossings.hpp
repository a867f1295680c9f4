// Raw pixels across a path: one profile for every column (or row) of pixels that the path crosses.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>

#include "arrays.hpp"
#include "detect/picture.hpp"

namespace vbaa::detect {

// Where a path crosses the middles of columns (or rows), and the raw profiles there. Copies share the profiles.
struct Crossings {
    Array<double, 2> points;   // (N, 2) px
    Array<int, 1> axis;        // (N,) of the coordinate along the profile: 1 (v) where the path runs sideways, or 0
    Array<double, 1> along;    // (N,) distance along the path from its start, px
    Array<double, 1> stretch;  // (N,) length along the profile per length across the path, at most about √2
    Array<double, 1> side;     // (N,) +1 or −1: whether the profile runs along the path's normal or against it
    Array<double, 1> bow;      // (N,) growth of the distance across with the square of that along the profile
    Array<double, 1> slant;    // (N,) cosine of the angle from the path's direction to the profile's
    Array<unsigned char, 1> inside;                               // (N,) whether the whole profile is in the picture
    ConstMatrix across;                                           // (N, T) distance along the profile from the path, px
    ConstMatrix profiles;                                         // (N, T) grey levels, zero where not inside
    std::shared_ptr<const std::array<Array<double, 2>, 2>> kept;  // owner of the memory of `across` and `profiles`
};

// Profiles of 2·half + 1 pixels of a picture's channel across a path (K, 2), times `sign` (−1 for a dark line).
Crossings crossings(const Picture& picture, ConstMatrix path_px, int half, double sign, int channel = 0);

// Every so many of the crossings.
Crossings every(const Crossings& found, int step);

// Distance along the path to the last crossing, at least 1 px.
inline double length_px(const Crossings& found) {
    return found.along.size() ? std::max(found.along[found.along.size() - 1], 1.0) : 1.0;
}

// (N,) how far along the path the crossings lie, as fractions of the last one's distance.
Array<double, 1> shares(const Crossings& found);

// Distances of profile n's pixels from a line through its `centre`, px, positive along the normal: into (T,).
void distances(const Crossings& found, int n, double centre, Vector across);

// Distances of profile n in units of the line's width, which is `width` there and grows by `growth` of itself per px
// along the line: a profile that crosses it at a slant meets one edge where the line is broader.
void in_width(Crossings& found, int n, double width, double growth);

// How a line's width changes: by `part` of it from start to end, and by `bend` times the square of the share of the way
// from the middle. Perspective makes the nearer end grow faster.
struct Taper {
    double part = 0.0, bend = 0.0;
};

// The crossings with distances in units of the width of a line that tapers.
Crossings tapered(Crossings found, const Taper& taper);

// (N, 2) the points moved along their profiles by (N,).
Array<double, 2> moved(const Crossings& found, ConstVector shift);

// Σ of the products of two rows (T,).
inline double dot(ConstVector one, ConstVector other) {
    double total = 0.0;
    for (int t = 0; t < one.shape[0]; ++t) total += one[t] * other[t];
    return total;
}

}  // namespace vbaa::detect
