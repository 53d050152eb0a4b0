// SPDX-License-Identifier: Apache-2.0
#include "codec/layout_plan.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace stgs {
namespace {

// Approximate bits of a stored table and its copy (spec 10.2): per symbol, and fixed.
constexpr double kSymbolBits = 8.0;
constexpr double kTableBits = 20.0;
constexpr std::size_t kMaxMixedTables = kMaxTables - 256;  // reserves one for each single symbol

double log_term(std::uint64_t count) {
  return count == 0 ? 0.0 : static_cast<double>(count) * std::log2(static_cast<double>(count));
}

// Planes that share a table.
struct Cluster {
  std::array<std::uint64_t, 256> counts{};
  std::array<double, 256> terms{};  // count log2 count
  std::uint64_t total = 0;
  double sum = 0.0;  // of the terms
  int used = 0;

  // Returns the bits of `total` symbols with the best table, and of the table.
  static double cost(std::uint64_t total, double sum, int used) {
    return log_term(total) - sum + (used > 1 ? kSymbolBits * used : 0.0) + kTableBits;
  }
  double cost() const { return cost(total, sum, used); }
  // Returns the cost of the union with another cluster.
  double cost_with(const Cluster& other) const {
    double both = 0.0;
    int either = 0;
    for (std::size_t s = 0; s < 256; ++s) {
      const std::uint64_t count = counts[s] + other.counts[s];
      if (count == 0) continue;
      ++either;
      const bool shared = counts[s] != 0 && other.counts[s] != 0;
      both += shared ? log_term(count) : terms[s] + other.terms[s];
    }
    return cost(total + other.total, both, either);
  }
  void add(const Cluster& other) {
    total += other.total;
    sum = 0.0;
    used = 0;
    for (std::size_t s = 0; s < 256; ++s) {
      counts[s] += other.counts[s];
      terms[s] = log_term(counts[s]);
      sum += terms[s];
      used += counts[s] != 0 ? 1 : 0;
    }
  }
};

Cluster cluster_of(const SymbolCounts& counts) {
  Cluster one, out;
  std::copy(counts.begin(), counts.end(), one.counts.begin());
  one.total = std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
  out.add(one);
  return out;
}

RansTable table_of(const Cluster& cluster) {
  // Scales the counts to 32 bits without turning any into 0.
  SymbolCounts counts;
  const std::uint64_t scale = cluster.total / 0xFFFFFFFF + 1;
  for (std::size_t s = 0; s < 256; ++s) {
    counts[s] = static_cast<std::uint32_t>((cluster.counts[s] + scale - 1) / scale);
  }
  return rans_table(counts);
}

}  // namespace

TablePlan plan_tables(const std::vector<SymbolCounts>& planes) {
  std::vector<Cluster> alone;
  alone.reserve(planes.size());
  for (const SymbolCounts& counts : planes) alone.push_back(cluster_of(counts));
  // The most expensive planes create tables first; the others join one if that is cheaper.
  std::vector<std::size_t> order(planes.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return alone[a].cost() > alone[b].cost(); });
  std::vector<Cluster> clusters;
  TablePlan out;
  out.table_of.resize(planes.size());
  for (const std::size_t p : order) {
    std::size_t best = clusters.size();
    const bool pure = alone[p].used <= 1;
    double best_cost = clusters.size() < (pure ? kMaxTables : kMaxMixedTables) ? 0.0 : 1e300;
    for (std::size_t k = 0; k < clusters.size(); ++k) {
      // Planes with a single symbol need no decoding, so they share tables only with each other.
      if ((clusters[k].used <= 1) != pure) continue;
      const double extra = clusters[k].cost_with(alone[p]) - clusters[k].cost() - alone[p].cost();
      if (extra >= best_cost) continue;
      best_cost = extra;
      best = k;
    }
    if (best == clusters.size()) clusters.emplace_back();
    clusters[best].add(alone[p]);
    out.table_of[p] = static_cast<std::uint16_t>(best);
  }
  for (const Cluster& cluster : clusters) out.tables.push_back(table_of(cluster));
  return out;
}

}  // namespace stgs
