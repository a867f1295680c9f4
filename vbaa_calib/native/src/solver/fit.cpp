#include <algorithm>

#include "solver/structs.hpp"

namespace vbaa::solver {

Work::Work(const Rig& rig, int points)
    : bent(rig),
      free(points, rig),
      best(free),
      found(free),
      other(free),
      kept(free),
      shift(free.nodes),
      product(free.nodes, free.side.size()),
      factor(free.side.size(), free.side.size()),
      scale(free.side.size()),
      step(free.side.size()) {}

Place locate(const Fit& fit, double length_m, double arclength_m) {
    const double inner = fit.contact_m / CONTACT, outer = (length_m - fit.contact_m) / NODES_BEYOND;
    const double beyond = std::max(arclength_m - fit.contact_m, 0.0);
    const double along = (arclength_m - beyond) / inner + beyond / outer;
    const double within = std::min(std::max(along, 0.0), LAST - 1e-6);
    const int node = within == within ? static_cast<int>(within) : 0;
    return {node, along - node, node < CONTACT ? inner : outer};
}

}  // namespace vbaa::solver
