#include "matern.hpp"

#include <algorithm>
#include <cmath>

#include "lanes.hpp"

namespace vbaa {
namespace {

// LANES views in C functions over D coordinates.
template <int C, int D>
struct Some {
    Lanes x[D], value[C], slope[C][D];
};

// Views eight at a time; those that fill the last eight repeat the last view.
template <int C, int D>
void gather(const Functionals& views, std::vector<Some<C, D>, Aligned<Some<C, D>>>& packs) {
    const int last = views.size() - 1;
    for (int begin = 0; begin <= last; begin += LANES) {
        Some<C, D> pack;
        for (int lane = 0; lane < LANES; ++lane) {
            const int i = std::min(begin + lane, last);
            for (int d = 0; d < D; ++d) pack.x[d][lane] = views.x(i, d);
            for (int c = 0; c < C; ++c) {
                pack.value[c][lane] = views.value(i, c);
                for (int d = 0; d < D; ++d) pack.slope[c][d][lane] = views.slope(i, c, d);
            }
        }
        packs.push_back(pack);
    }
}

void put(const Lanes& values, int begin, double* row, int count) {
    if (begin + LANES <= count) {
        store(row + begin, values);
    } else {
        for (int lane = 0; begin + lane < count; ++lane) row[begin + lane] = values[lane];
    }
}

template <int C, int D>
void fill_in(const Functionals& a, const Functionals& b, const MaternPrior& prior, Matrix covariance,
             Matrix by_log_length) {
    std::vector<Some<C, D>, Aligned<Some<C, D>>> packs;
    gather(b, packs);
    const int count = b.size();
    const bool with_slope = by_log_length.size() > 0;
    const double by_length = std::sqrt(5.0) / prior.length, square = prior.amplitude * prior.amplitude;
    const double steep = square * by_length * by_length / 3.0, bend = steep * by_length * by_length;
    const double offset = prior.offset * prior.offset, incline = prior.incline * prior.incline;
    for (int i = 0; i < a.size(); ++i) {
        for (int begin = 0, pack = 0; begin < count; begin += LANES, ++pack) {
            const Some<C, D>& other = packs[pack];
            Lanes apart[D], distance = spread(0.0);
            for (int d = 0; d < D; ++d) {
                apart[d] = a.x(i, d) - other.x[d];
                distance += apart[d] * apart[d];
            }
            Lanes values = spread(0.0), mixed = values, slopes = values, along = values, linear = values;
            for (int c = 0; c < C; ++c) {
                const double value = a.value(i, c);
                Lanes along_a = spread(0.0), along_b = along_a;
                for (int d = 0; d < D; ++d) {
                    const double slope = a.slope(i, c, d);
                    along_a += slope * apart[d];
                    along_b += other.slope[c][d] * apart[d];
                    slopes += slope * other.slope[c][d];
                    linear += (value * a.x(i, d) + slope) * (other.value[c] * other.x[d] + other.slope[c][d]);
                }
                values += value * other.value[c];
                mixed += value * along_b - other.value[c] * along_a;
                along += along_a * along_b;
            }
            const Lanes scaled = by_length * sqrt(distance), fade = exp(-scaled), both = steep * (mixed + slopes);
            const Lanes trend = offset * values + incline * linear;
            const Lanes process =
                square * values * (1.0 + scaled + scaled * scaled * (1.0 / 3.0)) + (1.0 + scaled) * both - bend * along;
            put(process * fade + trend, begin, covariance.row(i).data, count);
            if (!with_slope) continue;
            const Lanes change = (square / 3.0) * values * scaled * scaled * (1.0 + scaled) +
                                 (scaled * scaled - 2.0 * scaled - 2.0) * both - (scaled - 4.0) * bend * along;
            put(change * fade, begin, by_log_length.row(i).data, count);
        }
    }
}

}  // namespace

bool is_small(const Functionals& views) {
    const int functions = views.value.shape[1], coordinates = views.x.shape[1];
    return (functions == 1 || functions == 2) && (coordinates == 1 || coordinates == 2);
}

void matern_covariance(const Functionals& a, const Functionals& b, const MaternPrior& prior, Matrix covariance,
                       Matrix by_log_length) {
    const bool two = a.value.shape[1] == 2, flat = a.x.shape[1] == 2;
    const auto work = two ? (flat ? fill_in<2, 2> : fill_in<2, 1>) : (flat ? fill_in<1, 2> : fill_in<1, 1>);
    work(a, b, prior, covariance, by_log_length);
}

}  // namespace vbaa
