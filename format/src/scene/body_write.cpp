// SPDX-License-Identifier: Apache-2.0
#include "scene/body_write.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <mutex>
#include <numeric>
#include <stdexcept>

#include "codec/layout_plan.h"
#include "codec/planes.h"
#include "container/segment.h"
#include "scene/record_integers.h"
#include "scene/tier_segments.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

// Segments whose records share layouts: those of one tier with similar lifespans.
struct Group {
  std::vector<std::size_t> segments;
  GroupSteps steps;
  std::vector<StreamPlan> plans;  // by attribute
};

std::vector<Group> groups_of(const Encoding& encoding, const std::vector<TierSegment>& segments) {
  std::map<std::pair<int, int>, Group> by_kind;
  for (std::size_t s = 0; s < segments.size(); ++s) {
    const TierSegment& segment = segments[s];
    const int own = encoding.own_layouts ? static_cast<int>(s) : segment.importance;
    by_kind[{own, encoding.quantiser == nullptr ? 0 : segment.kind}].segments.push_back(s);
  }
  std::vector<Group> out;
  out.reserve(by_kind.size());
  for (auto& [key, group] : by_kind) out.push_back(std::move(group));
  if (encoding.quantiser == nullptr) return out;
  parallel_for(std::size_t{0}, out.size(), [&](std::size_t g) {
    std::vector<std::uint32_t> members;
    for (const std::size_t s : out[g].segments) {
      const std::vector<std::uint32_t>& more = segments[s].segment.members;
      members.insert(members.end(), more.begin(), more.end());
    }
    out[g].steps = encoding.quantiser->steps_of(*encoding.set, members,
                                                segments[out[g].segments.front()].importance);
  });
  return out;
}

constexpr std::size_t kSmallRecord = 4096;  // primitives
constexpr double kTableSymbolBits = 7.0;    // of a table, per symbol

// Returns the bits by which a plane with these counts is smaller in rANS than raw, if it has a
// table of its own.
double bits_saved(const SymbolCounts& counts) {
  const auto total = static_cast<double>(std::accumulate(counts.begin(), counts.end(), 0ull));
  double saved = 0;
  for (const std::uint32_t count : counts) {
    if (count > 0) saved += count * (8.0 + std::log2(count / total)) - kTableSymbolBits;
  }
  return saved;
}

// Writes the records of a body.
class BodyWriter {
 public:
  BodyWriter(const Encoding& encoding, std::vector<TierSegment>& segments, Body& body)
      : encoding_(encoding),
        segments_(segments),
        body_(body),
        attributes_(streams_of(encoding.set->sh_degree)),
        groups_(groups_of(encoding, segments)),
        group_of_(segments.size()),
        integers_(segments.size()),
        planes_(segments.size()),
        errors_(segments.size()),
        coded_bytes_(attributes_.size()),
        stored_bytes_(segments.size(), std::vector<double>(attributes_.size())) {
    for (std::size_t g = 0; g < groups_.size(); ++g) {
      for (const std::size_t s : groups_[g].segments) group_of_[s] = g;
    }
  }

  void write() {
    const bool quantised = encoding_.quantiser != nullptr;
    counts_.resize(groups_.size() * kinds());
    const auto each_segment = [this](const auto& work) {
      parallel_for(std::size_t{0}, segments_.size(), [&](std::size_t s) {
        check_stop();
        work(s);
      });
    };
    if (quantised) each_segment([this](std::size_t s) { quantise(s); });
    plan_streams();
    each_segment([&](std::size_t s) {
      if (!quantised) quantise(s);
      split(s);
      if (encoding_.source != nullptr) measure(s);
      count(s);
      if (!quantised) planes_[s].clear();  // computed again below: they are as large as the scene
    });
    if (!quantised) choose_coders();
    make_layouts();
    body_.bases.resize(segments_.size());
    body_.sh.resize(segments_.size());
    each_segment([&](std::size_t s) {
      if (!quantised) {
        quantise(s);
        split(s);
      }
      write_records(s);
    });
    for (std::size_t a = 0; a < attributes_.size(); ++a) {
      double sum = coded_bytes_[a];
      for (const auto& segment : stored_bytes_) sum += segment[a];
      body_.index.attributes.push_back(
          {static_cast<std::uint16_t>(attributes_[a]), static_cast<std::uint64_t>(sum)});
    }
    if (!encoding_.own_layouts) body_.layouts = std::move(sets_.front());
    for (const CodingErrors& errors : errors_) body_.errors.add(errors);
  }

 private:
  void check_stop() const {
    if (encoding_.stop.stop_requested()) throw std::runtime_error("stopped");
  }

  // The attributes [first, last) of a record: all of them, or the SH, or the others.
  struct Range {
    std::size_t first = 0, last = 0;
  };
  std::size_t kinds() const {
    return encoding_.quantiser != nullptr && attributes_.size() > streams_of(0).size() ? 2 : 1;
  }
  Range range_of(std::size_t kind) const {
    const std::size_t base = kinds() == 2 ? streams_of(0).size() : attributes_.size();
    return kind == 0 ? Range{0, base} : Range{base, attributes_.size()};
  }

  // Computes the integers of a segment and puts its members into the order of the file.
  void quantise(std::size_t s) {
    std::vector<std::uint32_t>& members = segments_[s].segment.members;
    const Gaussians4D part = encoding_.set->gather(members);
    if (encoding_.quantiser == nullptr) {
      integers_[s] = lossless_integers(part);
      add_sh_degrees(integers_[s]);
      return;
    }
    const IndexEntry& entry = body_.index.segments[s].base;
    const PartEntry& in = body_.parts[body_.index.segments[s].part];
    const double begin = begin_of(entry.level, entry.slot, encoding_.chunk_ticks);
    std::vector<std::uint32_t> order;
    integers_[s] = encoding_.quantiser->quantise(part, groups_[group_of_[s]].steps, begin,
                                                 part_exponent_of(in.end - in.begin), order);
    add_sh_degrees(integers_[s]);
    for (std::uint32_t& i : order) i = members[i];
    members = std::move(order);
  }

  void plan_streams() {
    for (Group& group : groups_) group.plans.resize(attributes_.size());
    parallel_for(std::size_t{0}, groups_.size() * attributes_.size(), [&](std::size_t job) {
      check_stop();
      Group& group = groups_[job / attributes_.size()];
      const std::size_t a = job % attributes_.size();
      if (encoding_.quantiser == nullptr) {
        group.plans[a] = plan_floats(attributes_[a]);
        return;
      }
      if (encoding_.draco && attributes_[a] == Attribute::kPosition) {
        group.plans[a] = plan_draco(integers_[group.segments.front()][a]);
        return;
      }
      std::vector<const Integers*> records;
      for (const std::size_t s : group.segments) records.push_back(&integers_[s][a]);
      group.plans[a] = plan_stream(records, encoding_.coder);
    });
    for (Group& group : groups_) join_streams(group);
  }

  // Lets streams share a group of planes, because every group stores states: those of the lifespan,
  // and, in small records, those of the motion and those of the look.
  void join_streams(Group& group) const {
    std::size_t primitives = 0;
    for (const std::size_t s : group.segments) primitives += segments_[s].segment.members.size();
    const bool small = primitives < kSmallRecord * group.segments.size();
    const auto in_group = [&](std::size_t a) { return group.plans[a].row.in_group(); };
    for (std::size_t a = 1; a < streams_of(0).size(); ++a) {
      const Attribute attribute = attributes_[a];
      const bool lifespan = attribute == Attribute::kSigma || attribute == Attribute::kRadius;
      const bool begins = attribute == Attribute::kTime || attribute == Attribute::kLogScale;
      const bool wanted = lifespan || (small && !begins);
      group.plans[a].row.joins = wanted && in_group(a) && in_group(a - 1);
    }
  }

  // Converts the integers of a segment to the planes of its records.
  void split(std::size_t s) {
    const std::vector<StreamPlan>& plans = groups_[group_of_[s]].plans;
    for (std::size_t kind = 0; kind < kinds(); ++kind) {
      RecordPlanes& planes = planes_[s].emplace_back();
      planes.n = segments_[s].segment.members.size();
      const Range range = range_of(kind);
      for (std::size_t a = range.first; a < range.last; ++a) {
        Integers& integers = integers_[s][a];
        if (integers.morton) planes.first_key = first_key_of(integers, plans[a]);
        if (const int band = band_of(integers.attribute); band > 0)
          planes.sh[static_cast<std::size_t>(band - 1)] =
              static_cast<std::uint32_t>(integers.size());
        append_planes(integers, plans[a], planes.symbols);
        integers = {};
      }
    }
  }

  // Measures the differences between a segment's planes and the source.
  void measure(std::size_t s) {
    const IndexEntry& entry = body_.index.segments[s].base;
    const PartEntry& in = body_.parts[body_.index.segments[s].part];
    const Gaussians4D coded =
        map_planes(planes_[s], groups_[group_of_[s]].plans, encoding_.set->sh_degree,
                   begin_of(entry.level, entry.slot, encoding_.chunk_ticks),
                   part_exponent_of(in.end - in.begin));
    errors_[s].add(*encoding_.source, segments_[s].segment.members, coded, in.end - in.begin);
  }

  // Counts the symbols of a segment's planes.
  void count(std::size_t s) {
    for (std::size_t kind = 0; kind < kinds(); ++kind) {
      const RecordPlanes& planes = planes_[s][kind];
      std::vector<SymbolCounts> counts;
      const std::uint8_t* at = planes.symbols.data();
      const Range range = range_of(kind);
      for (std::size_t a = range.first; a < range.last; ++a) {
        const std::size_t symbols = planes.symbols_of(attributes_[a]);
        for (std::size_t p = 0; p < groups_[group_of_[s]].plans[a].row.planes(); ++p) {
          SymbolCounts& plane = counts.emplace_back();
          for (std::size_t i = 0; i < symbols; ++i) ++plane[*at++];
        }
      }
      const std::lock_guard lock(counting_);
      std::vector<SymbolCounts>& sums = counts_[group_of_[s] * kinds() + kind];
      sums.resize(counts.size());
      for (std::size_t p = 0; p < sums.size(); ++p) {
        for (std::size_t k = 0; k < sums[p].size(); ++k) sums[p][k] += counts[p][k];
      }
    }
  }

  // Codes the floats of a lossless scene with rANS where that saves bytes.
  void choose_coders() {
    for (std::size_t g = 0; g < groups_.size(); ++g) {
      auto plane = counts_[g].begin();
      for (StreamPlan& plan : groups_[g].plans) {
        double saved = 0;
        for (std::size_t p = 0; p < plan.row.planes(); ++p) saved += bits_saved(*plane++);
        if (saved > 0 && encoding_.coder == Coder::kRans)
          plan.row.coder = static_cast<std::uint8_t>(Coder::kRans);
      }
    }
  }

  // Creates the layouts of all kinds of records, in one set or one set each, with tables as far as
  // they pay off.
  void make_layouts() {
    const std::size_t uses = groups_.size() * kinds();
    sets_.resize(encoding_.own_layouts ? uses : 1);
    std::vector<std::vector<SymbolCounts>> counts;
    for (std::size_t use = 0; use < uses; ++use) counts.push_back(coded_counts(use));
    for (std::size_t use = 0; use < uses; ++use) {
      Layout& layout = set_of(use).layouts.emplace_back();
      const Range range = range_of(use % kinds());
      for (std::size_t a = range.first; a < range.last; ++a) {
        layout.streams.push_back(groups_[use / kinds()].plans[a].row);
      }
    }
    parallel_for(std::size_t{0}, sets_.size(), [&](std::size_t k) {
      const std::size_t first = encoding_.own_layouts ? k : 0;
      make_tables(std::span(counts).subspan(first, sets_[k].layouts.size()), sets_[k]);
    });
    for (std::size_t use = 0; use < uses; ++use) add_cost(use, counts[use]);
  }

  LayoutSet& set_of(std::size_t use) { return sets_[encoding_.own_layouts ? use : 0]; }
  Layout& layout_of(std::size_t use) {
    return set_of(use).layouts[encoding_.own_layouts ? 0 : use];
  }

  // Returns the counts of the planes coded with rANS, in the records of a group and kind.
  std::vector<SymbolCounts> coded_counts(std::size_t use) const {
    std::vector<SymbolCounts> out;
    auto plane = counts_[use].begin();
    const Range range = range_of(use % kinds());
    for (std::size_t a = range.first; a < range.last; ++a) {
      const StreamRow& row = groups_[use / kinds()].plans[a].row;
      const auto end = plane + static_cast<std::ptrdiff_t>(row.planes());
      if (row.in_group()) out.insert(out.end(), plane, end);
      plane = end;
    }
    return out;
  }

  // `counts`: of the planes of each of the set's layouts.
  static void make_tables(std::span<const std::vector<SymbolCounts>> counts, LayoutSet& set) {
    std::vector<SymbolCounts> all;
    for (const auto& of_layout : counts) all.insert(all.end(), of_layout.begin(), of_layout.end());
    TablePlan plan = plan_tables(all);
    auto table = plan.table_of.begin();
    for (Layout& layout : set.layouts) {
      for (StreamRow& row : layout.streams) {
        if (static_cast<Coder>(row.coder) != Coder::kRans) continue;
        row.tables.assign(table, table + static_cast<std::ptrdiff_t>(row.planes()));
        table += static_cast<std::ptrdiff_t>(row.planes());
      }
    }
    set.tables = std::move(plan.tables);
    for (const RansTable& t : set.tables) set.only.push_back(only_symbol(t));
  }

  // Adds the bytes of the coded planes of a layout, by attribute.
  void add_cost(std::size_t use, const std::vector<SymbolCounts>& counts) {
    auto of_plane = counts.begin();
    std::size_t a = range_of(use % kinds()).first;
    for (const StreamRow& row : layout_of(use).streams) {
      double bits = 0;
      for (const std::uint16_t table : row.tables)
        bits += rans_cost(set_of(use).tables[table], *of_plane++);
      coded_bytes_[a++] += std::round(bits / 8.0);
    }
  }

  void write_records(std::size_t s) {
    SegmentEntry& entry = body_.index.segments[s];
    for (std::size_t kind = 0; kind < kinds(); ++kind) {
      const std::size_t use = group_of_[s] * kinds() + kind;
      const bool own = encoding_.own_layouts;
      const RecordCoding coding{&set_of(use), static_cast<std::uint16_t>(own ? 0 : use), own};
      const SegmentPayload payload =
          write_segment(kind == 0 ? entry.base : entry.sh_entry(), encoding_.set->sh_degree,
                        planes_[s][kind], coding);
      std::vector<std::uint8_t>& record = (kind == 0 ? body_.bases : body_.sh)[s];
      record = write_record(kSegmentTag, payload.bytes);
      (kind == 0 ? entry.base : entry.sh).bytes = record.size();
      for (std::size_t i = 0; i < payload.stored.size(); ++i) {
        stored_bytes_[s][range_of(kind).first + i] += static_cast<double>(payload.stored[i]);
      }
    }
    planes_[s].clear();
  }

  const Encoding& encoding_;
  std::vector<TierSegment>& segments_;
  Body& body_;
  std::span<const Attribute> attributes_;
  std::vector<Group> groups_;
  std::vector<std::size_t> group_of_;              // by segment
  std::vector<std::vector<Integers>> integers_;    // by segment and attribute
  std::vector<std::vector<RecordPlanes>> planes_;  // by segment and kind of record
  std::vector<CodingErrors> errors_;               // by segment
  std::vector<LayoutSet> sets_;                    // one, or one for each group and kind
  std::mutex counting_;
  std::vector<std::vector<SymbolCounts>> counts_;  // by group and kind, and plane
  std::vector<double> coded_bytes_;                // by attribute
  std::vector<std::vector<double>> stored_bytes_;  // by segment and attribute
};

}  // namespace

Body encode_body(const Encoding& encoding, const std::vector<PartRange>& parts) {
  Body body;
  std::vector<TierSegment> segments = plan_segments(encoding, parts, body);
  BodyWriter(encoding, segments, body).write();
  for (const TierSegment& segment : segments) {
    const std::vector<std::uint32_t>& members = segment.segment.members;
    body.index.primitives += members.size();
    body.order.insert(body.order.end(), members.begin(), members.end());
  }
  return body;
}

}  // namespace stgs
