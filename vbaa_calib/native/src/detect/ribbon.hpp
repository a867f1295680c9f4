// An antenna in its strip of the picture: an opaque ribbon of known width between two backgrounds that are free in
// every profile. What it shows of itself changes smoothly along it, in each of the picture's channels: shades.hpp's
// series. Its course across the strip is a smooth curve. All of it is solved for together, by Gauss–Newton, with
// Gaussian priors of standard deviations from the picture itself (empirical Bayes); a chain decides in which profiles
// it is hidden.
#pragma once

#include <vector>

#include "detect/crossings.hpp"
#include "detect/shades.hpp"

namespace vbaa::detect {

// What is supposed of it.
struct RibbonPriors {
    double width_std, blur_std, taper_std;  // prior deviations, of logarithms; of the part by which it tapers
    double shades;                          // over the antenna's contrast
    double bend_px;                         // of the course's second difference over 20 px: what the path is off by
    double knot_px;                         // between which its shades change linearly
    double alike;                           // share of a profile's log odds that its neighbours do not have, too
    double change_px;                       // length after which it is hidden, or seen again
    double cut;                             // deviations at which a pixel counts half
    int passes;                             // rounds
};

// What is found of N profiles.
struct Ribbon {
    Numbers centre;     // (N,) along the profiles from the path, px
    Numbers sigma_px;   // (N,) deviation across the antenna, by the pixels of the profile alone
    Numbers shared_px;  // (N,) what neighbours share of the place's error: light, width and blur that are not known
    Numbers seen;       // (N,) probability that it is seen there
    Numbers height;  // (N,) what it shows above the mean of its two sides, grey levels: root mean square over it, all
                     // channels
    int strongest;   // channel in which it stands out the most
    Table shades;    // (N, SHADES) above the mean of both sides, grey levels of that channel
    double noise;    // of a pixel, grey levels
    double pattern;  // variance of what is left alike all along it where it is, over that of the noise
    double width_px, blur_px;
};

// Profiles (one entry a channel, of the same path) of an antenna of this width, seen through this blur.
Ribbon fitted_ribbon(const std::vector<Crossings>& channels, double width_px, double blur_px,
                     const RibbonPriors& model);

}  // namespace vbaa::detect
