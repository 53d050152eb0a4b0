// SPDX-License-Identifier: Apache-2.0
#include "layout_plan.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace stgs {
namespace {

// Of a stored table, for each symbol that it has and beside these, about; its copy (spec 3.6) too.
constexpr double kSymbolBits = 8.0;
constexpr double kTableBits = 20.0;
constexpr std::size_t kMostMixed = kMaxTables - 256;  // one is left for each only symbol

double log_term(std::uint64_t count) {
  return count == 0 ? 0.0 : static_cast<double>(count) * std::log2(static_cast<double>(count));
}

// Symbols that share a table.
struct Cluster {
  std::array<std::uint64_t, 256> counts{};
  std::array<double, 256> terms{};  // count log2 count
  std::uint64_t total = 0;
  double sum = 0.0;  // of the terms
  int used = 0;

  // Bits of so many symbols with the best table, and of the table.
  static double cost(std::uint64_t total, double sum, int used) {
    return log_term(total) - sum + (used > 1 ? kSymbolBits * used : 0.0) + kTableBits;
  }
  double cost() const { return cost(total, sum, used); }
  // Of the symbols of both.
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
  // Counts as a table takes them: 32 bits, and none lost.
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
  for (const SymbolCounts& counts : planes) alone.push_back(cluster_of(counts));
  // The planes that cost most make tables first, the others join where that is cheaper.
  std::vector<std::size_t> order(planes.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return alone[a].cost() > alone[b].cost(); });
  std::vector<Cluster> clusters;
  TablePlan out;
  out.table_of.resize(planes.size());
  for (const std::size_t p : order) {
    std::size_t best = clusters.size();
    const bool pure = alone[p].used == 1;
    double least = clusters.size() < (pure ? kMaxTables : kMostMixed) ? 0.0 : 1e300;
    for (std::size_t k = 0; k < clusters.size(); ++k) {
      // Planes of one symbol need not be decoded, so they share a table with none but their like.
      if ((clusters[k].used == 1) != pure) continue;
      const double more = clusters[k].cost_with(alone[p]) - clusters[k].cost() - alone[p].cost();
      if (more >= least) continue;
      least = more;
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
