// SPDX-License-Identifier: Apache-2.0
#include "cuda/segment_decode.h"

#include <algorithm>

#include "cuda/upload.h"

namespace stgs::player::cuda {
namespace {

struct View {
  float* data = nullptr;
  std::uint32_t stride = 0;
};

View view_of(const DeviceGaussians& set, Attribute attribute, int sh_degree) {
  const auto sh_stride = static_cast<std::uint32_t>(3 * (sh_degree + 1) * (sh_degree + 1));
  switch (attribute) {
    case Attribute::kPosition:
      return {set.position, 3};
    case Attribute::kTime:
      return {set.time, 1};
    case Attribute::kSigma:
      return {set.sigma, 1};
    case Attribute::kRadius:
      return {set.radius, 1};
    case Attribute::kVelocity:
      return {set.velocity, 3};
    case Attribute::kLogScale:
      return {set.log_scale, 3};
    case Attribute::kRotation:
      return {set.rotation, 4};
    case Attribute::kOpacity:
      return {set.opacity_logit, 1};
    case Attribute::kSh0:
      return {set.sh, sh_stride};
    case Attribute::kShDegree:
      return {};
    case Attribute::kSh1:
      return {set.sh + 3, sh_stride};
    case Attribute::kSh2:
      return {set.sh + 12, sh_stride};
    case Attribute::kSh3:
      return {set.sh + 27, sh_stride};
  }
  return {};
}

// Returns whether other attributes of the primitive must be decoded first.
bool depends_on_others(const CodedStream& stream) {
  return stream.mapping == Mapping::kDisplacement || stream.mapping == Mapping::kShapedRotation;
}

bool is_summed(const CodedStream& stream) {
  return stream.prediction == Prediction::kDelta || stream.prediction == Prediction::kMorton;
}

// Returns the number of components that are mapped together.
std::uint32_t width_of(const CodedStream& stream) {
  if (stream.attribute == Attribute::kRotation) {
    return static_cast<std::uint32_t>(stream.components);
  }
  const bool three = stream.mapping == Mapping::kColour || stream.attribute == Attribute::kLogScale;
  return three ? 3 : 1;
}

// Returns whether other streams depend on the integers of this one.
bool is_kept(const CodedStream& stream) {
  return stream.attribute == Attribute::kSigma || stream.attribute == Attribute::kRadius ||
         stream.attribute == Attribute::kLogScale;
}

// Memory for a segment, bytes: uploaded, and on the device only; and the number of its streams and
// of the works to map them, at most.
struct Need {
  std::size_t upload = 0, scratch = 0, streams = 0, works = 0;
};

Need need_of(const CodedSegment& segment) {
  Need need;
  need.upload = aligned(sizeof(CodedEnd) * segment.ends.size()) + sizeof(EndJob);
  for (const CodedRecord& record : segment.records) {
    need.upload += aligned(record.stored.size()) + aligned(record.bytes.size()) +
                   sizeof(RansLookup) * record.lookups.size();
    for (const CodedGroup& group : record.groups) {
      need.upload += aligned(sizeof(RansBlockLocation) * group.blocks.size()) +
                     aligned(sizeof(std::uint16_t) * group.tables.size()) + sizeof(RansGroup) +
                     sizeof(RansWork) * (group.blocks.size() / kRansWarps + 1);
      need.scratch += aligned(std::size_t{group.symbols} * group.tables.size());
    }
    need.upload += sizeof(ClearJob);
    for (const CodedStream& stream : record.streams) {
      const std::size_t chunks = map_chunks(stream.symbols);
      ++need.streams;
      need.works += chunks * stream.components;
      need.upload += aligned(sizeof(MapPlane) * stream.planes.size()) + sizeof(MapJob) +
                     sizeof(std::uint32_t) + 2 * sizeof(MapWork) * chunks * stream.components +
                     aligned(sizeof(std::uint32_t) * stream.members.size());
      if (is_summed(stream))
        need.scratch += aligned(sizeof(std::uint32_t) * chunks * stream.components);
      if (is_kept(stream)) need.scratch += aligned(sizeof(std::uint32_t) * stream.symbols);
    }
  }
  return need;
}

constexpr std::size_t kPlanArrays = 9;  // per plan, each aligned
constexpr int kPhases = 2;              // of mapping

// Returns whether all primitives have all spherical harmonics of the file's degree.
bool has_sh(const CodedSegment& segment) {
  std::size_t coefficients = 0;
  for (const CodedRecord& record : segment.records) {
    for (const CodedStream& stream : record.streams) {
      if (stream.attribute >= Attribute::kSh0 && stream.members.empty())
        coefficients += stream.components;
    }
  }
  return coefficients ==
         static_cast<std::size_t>(3 * (segment.sh_degree + 1) * (segment.sh_degree + 1));
}

}  // namespace

// Writes the work of several segments to staging memory.
class SegmentDecoder::Plan {
 public:
  Plan(Upload upload, std::uint8_t* scratch, const std::uint32_t* tables, std::uint32_t* flags,
       const Need& need)
      : upload_(upload), scratch_(scratch), tables_(tables), flags_(flags) {
    jobs_.reserve(need.streams);
    work_[0].reserve(need.works);
  }

  void add(const CodedSegment& segment, const DeviceGaussians& to) {
    for (const CodedRecord& record : segment.records) {
      const std::uint8_t* const stored = upload_.add(record.stored);
      const std::uint8_t* const bytes = upload_.add(record.bytes);
      const std::uint32_t* const lookups =
          record.own_tables ? reinterpret_cast<const std::uint32_t*>(upload_.add(record.lookups))
                            : tables_;
      std::size_t planes = 0;  // bytes
      for (const CodedGroup& group : record.groups)
        planes += std::size_t{group.symbols} * group.tables.size();
      std::uint8_t* const symbols = take(planes);
      std::uint8_t* next = symbols;
      for (const CodedGroup& group : record.groups) {
        add_group(group, bytes, lookups, next);
        next += std::size_t{group.symbols} * group.tables.size();
      }
      for (const CodedStream& stream : record.streams)
        add_stream(segment, to, stream, symbols, stored);
    }
    ++flags_;
  }

  // Clears the SH of a segment that does not have all of them.
  void clear_sh(const CodedSegment& segment, const DeviceGaussians& to) {
    const auto coefficients =
        static_cast<std::uint64_t>((segment.sh_degree + 1) * (segment.sh_degree + 1));
    clears_.push_back({to.sh, 3 * coefficients * segment.primitives});
  }

  void add_ends(const CodedSegment& segment, const DeviceGaussians& to) {
    ends_.push_back({to, upload_.add(segment.ends), size_of(segment.ends),
                     static_cast<float>(-segment.time_origin)});
  }

  Launch finish() {
    Launch out;
    out.ends = upload_.add(ends_);
    out.end_count = size_of(ends_);
    out.clears = upload_.add(clears_);
    out.clear_count = size_of(clears_);
    const std::vector<RansWork> rans = rans_work(group_sizes_);
    out.groups = upload_.add(groups_);
    out.rans = upload_.add(rans);
    out.rans_count = size_of(rans);
    out.jobs = upload_.add(jobs_);
    out.sums = upload_.add(sum_work_);
    out.sum_count = size_of(sum_work_);
    out.summed = upload_.add(summed_);
    out.summed_count = size_of(summed_);
    for (int phase = 0; phase < kPhases; ++phase) {
      out.maps[phase] = upload_.add(work_[phase]);
      out.map_count[phase] = size_of(work_[phase]);
    }
    upload_.copy_large();
    out.upload = upload_.used();
    return out;
  }

 private:
  template <typename T>
  static std::uint32_t size_of(const std::vector<T>& values) {
    return static_cast<std::uint32_t>(values.size());
  }
  // Allocates scratch memory.
  std::uint8_t* take(std::size_t bytes) {
    std::uint8_t* const at = scratch_;
    scratch_ += aligned(bytes);
    return at;
  }

  void add_group(const CodedGroup& coded, const std::uint8_t* bytes, const std::uint32_t* lookups,
                 std::uint8_t* symbols) {
    RansGroup group;
    group.bytes = bytes + coded.offset;
    group.blocks = upload_.add(coded.blocks);
    group.tables = upload_.add(coded.tables);
    group.lookups = lookups;
    group.symbols = symbols;
    group.damaged = flags_;
    group.count = coded.symbols;
    group.planes = size_of(coded.tables);
    groups_.push_back(group);
    group_sizes_.push_back(coded.symbols);
  }

  const MapPlane* add_planes(const CodedStream& stream, const std::uint8_t* symbols,
                             const std::uint8_t* stored) {
    std::vector<MapPlane>& planes = planes_;
    planes.clear();
    for (const CodedPlane& plane : stream.planes) {
      switch (plane.source) {
        case CodedPlane::Source::kConstant:
          planes.push_back({nullptr, plane.only});
          break;
        case CodedPlane::Source::kGroup:
          planes.push_back({symbols + plane.offset, 0});
          break;
        case CodedPlane::Source::kStored:
          planes.push_back({stored + plane.offset, 0});
          break;
      }
    }
    return upload_.add(planes);
  }

  std::uint32_t* take_numbers(std::size_t count) {
    return reinterpret_cast<std::uint32_t*>(take(sizeof(std::uint32_t) * count));
  }

  // Sets what a stream needs of others, and leaves to them.
  void link(const CodedSegment& segment, const CodedStream& stream, MapJob& job) {
    job.sigma = kept_[0];
    job.radius = kept_[1];
    job.spread = kept_[2];
    job.part_exponent = segment.part_exponent;
    std::copy(segment.shape_bounds.begin(), segment.shape_bounds.end(), job.shape_bounds);
    if (!is_kept(stream)) return;
    job.keep = take_numbers(stream.symbols);
    kept_[stream.attribute == Attribute::kSigma    ? 0
          : stream.attribute == Attribute::kRadius ? 1
                                                   : 2] = job.keep;
  }

  void add_stream(const CodedSegment& segment, const DeviceGaussians& to, const CodedStream& stream,
                  const std::uint8_t* symbols, const std::uint8_t* stored) {
    const std::uint32_t number = size_of(jobs_), chunks = map_chunks(stream.symbols);
    const View view = view_of(to, stream.attribute, segment.sh_degree);
    MapJob job;
    job.planes = add_planes(stream, symbols, stored);
    job.to = view.data;
    job.stride = view.stride;
    if (!stream.members.empty()) job.members = upload_.add(stream.members);
    link(segment, stream, job);
    job.is_invalid = flags_;
    job.first_key = segment.first_key;
    std::copy(stream.origin.begin(), stream.origin.end(), job.origin);
    if (stream.mapping == Mapping::kTime) {
      job.time_base =
          static_cast<float>(time_base(segment.begin, stream.step) - segment.time_origin);
    }
    job.values = stream.symbols;
    job.chunks = chunks;
    job.step = stream.step;
    job.max_steps = max_steps(stream.mapping, stream.step.multiplier);
    job.components = static_cast<std::uint32_t>(stream.components);
    job.digits = static_cast<std::uint32_t>(stream.digits);
    job.low = static_cast<std::uint32_t>(stream.low);
    job.low_digits = (job.low + 7) / 8;
    job.width = width_of(stream);
    job.attribute = stream.attribute;
    job.mapping = stream.mapping;
    job.prediction = stream.prediction;
    std::copy(stream.digit_bits.begin(), stream.digit_bits.end(), job.digit_bits);
    if (is_summed(stream)) {
      job.sums = take_numbers(chunks * stream.components);
      summed_.push_back(number);
    }
    jobs_.push_back(job);
    std::vector<MapWork>& maps = work_[depends_on_others(stream) ? 1 : 0];
    for (std::uint32_t chunk = 0; chunk < chunks; ++chunk) {
      for (std::uint32_t c = 0; is_summed(stream) && c < job.components; ++c) {
        sum_work_.push_back({number, chunk, c});
      }
      for (std::uint32_t c = 0; c < job.components; c += job.width)
        maps.push_back({number, chunk, c});
    }
  }

  Upload upload_;
  std::uint8_t* scratch_;
  const std::uint32_t* tables_;
  std::uint32_t* flags_;         // of the segment being added
  std::uint32_t* kept_[3] = {};  // of the segment: sigma, radius and log scales
  std::vector<MapJob> jobs_;
  std::vector<std::uint32_t> summed_;  // indices of jobs with sums
  std::vector<MapPlane> planes_;       // of the stream being added
  std::vector<ClearJob> clears_;
  std::vector<EndJob> ends_;
  std::vector<MapWork> sum_work_, work_[kPhases];
  std::vector<RansGroup> groups_;
  std::vector<std::uint32_t> group_sizes_;
};

Status SegmentDecoder::set_tables(std::span<const RansLookup> tables, cudaStream_t stream) {
  STGS_TRY(tables_.ensure(tables.size_bytes()));
  return cuda_status(cudaMemcpyAsync(tables_.data(), tables.data(), tables.size_bytes(),
                                     cudaMemcpyHostToDevice, stream),
                     "uploading tables");
}

Status SegmentDecoder::prepare(std::span<const CodedSegment* const> segments,
                               std::span<const DeviceGaussians> to) {
  Need need;
  need.upload = kArrayAlign * kPlanArrays;
  for (const CodedSegment* segment : segments) {
    const Need one = need_of(*segment);
    need.upload += one.upload;
    need.scratch += one.scratch;
    need.streams += one.streams;
    need.works += one.works;
  }
  const std::size_t flag_bytes = sizeof(std::uint32_t) * segments.size();
  STGS_TRY(staging_.ensure(need.upload));
  STGS_TRY(input_.ensure(need.upload));
  STGS_TRY(scratch_.ensure(need.scratch));
  STGS_TRY(flags_.ensure(flag_bytes));
  STGS_TRY(host_flags_.ensure(flag_bytes));
  segments_ = segments.size();
  Plan plan({staging_.data(), input_.data()}, scratch_.data(),
            reinterpret_cast<const std::uint32_t*>(tables_.data()),
            reinterpret_cast<std::uint32_t*>(flags_.data()), need);
  for (std::size_t k = 0; k < segments.size(); ++k) {
    const CodedSegment& segment = *segments[k];
    plan.add(segment, to[k]);
    if (!has_sh(segment)) plan.clear_sh(segment, to[k]);
    if (!segment.ends.empty()) plan.add_ends(segment, to[k]);
  }
  launch_ = plan.finish();
  return {};
}

Status SegmentDecoder::launch(cudaStream_t stream) {
  stream_ = stream;
  const std::size_t flag_bytes = sizeof(std::uint32_t) * segments_;
  STGS_TRY(cuda_status(cudaMemsetAsync(flags_.data(), 0, flag_bytes, stream), "clearing flags"));
  STGS_TRY(cuda_status(cudaMemcpyAsync(input_.data(), staging_.data(), launch_.upload,
                                       cudaMemcpyHostToDevice, stream),
                       "uploading segments"));
  clear_ranges(launch_.clears, launch_.clear_count, stream);
  decode_rans(launch_.groups, launch_.rans, launch_.rans_count, stream);
  sum_differences(launch_.jobs, launch_.sums, launch_.sum_count, launch_.summed,
                  launch_.summed_count, stream);
  for (int phase = 0; phase < kPhases; ++phase) {
    map_streams(launch_.jobs, launch_.maps[phase], launch_.map_count[phase], stream);
  }
  apply_ends(launch_.ends, launch_.end_count, stream);
  STGS_TRY(cuda_status(cudaGetLastError(), "launching the decoding"));
  return cuda_status(cudaMemcpyAsync(host_flags_.data(), flags_.data(), flag_bytes,
                                     cudaMemcpyDeviceToHost, stream),
                     "reading back flags");
}

Result<std::vector<bool>> SegmentDecoder::finish() {
  STGS_TRY(cuda_status(cudaStreamSynchronize(stream_), "decoding"));
  const auto* const flags = reinterpret_cast<const std::uint32_t*>(host_flags_.data());
  std::vector<bool> intact(segments_);
  for (std::size_t k = 0; k < segments_; ++k) intact[k] = flags[k] == 0;
  return intact;
}

}  // namespace stgs::player::cuda
