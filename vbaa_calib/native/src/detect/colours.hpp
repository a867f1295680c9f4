// The antenna's colours in a picture: how brightly it is lit, and which points have another colour.
#pragma once

#include "detect/picture.hpp"

namespace vbaa::detect {

// RUN: points averaged for a colour. FOREIGN, MOSTLY_FOREIGN: standard deviations from the usual colour beyond which a
// point, or in the median the whole line, is no antenna.
constexpr int RUN = 15;
constexpr double FOREIGN = 4.0, MOSTLY_FOREIGN = 2.5;

// (N, 3) colours at the pixels nearest to points (N, 2), grey levels of 8 bits, one of which is `level` of the
// picture's; grey is three times one.
Array<double, 2> colours_at(const Picture& picture, double level, ConstMatrix points);

// Which points do not have the antenna's colours.
struct Foreign {
    Array<unsigned char, 1> other;   // (N,) whether they do not
    Array<double, 1> off;            // (N,) how far off the usual colour in this light, standard deviations
    Array<double, 1> hue;            // (N,) the same if it may be darker or brighter there, as in a shadow
    Array<unsigned char, 1> tinted;  // (N,) whether the hue differs from that of the line in the light
};

// Compares points (N, 2), at shares (N,) of the way from clamp to tip, with the antenna's looks (PLACES, 4).
Foreign foreign(const Picture& picture, double level, ConstMatrix points, ConstVector shares, ConstMatrix looks);

}  // namespace vbaa::detect
