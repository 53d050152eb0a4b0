// SPDX-License-Identifier: Apache-2.0
// Reading SOG version 2, as specified by PlayCanvas ("The SOG Format", developer.playcanvas.com): a
// meta.json, and images whose pixel i belongs to splat i. Axes: as 3DGS PLY.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "interchange/named_files.h"
#include "interchange/sog_layout.h"

namespace stgs {

// A model whose description has been read.
struct SogModel {
  std::unique_ptr<NamedFiles> files;
  SogLayout layout;
};

// Reads the description of a model. Checks the sizes of its images without decoding them; allocates
// no memory for splats.
Result<SogModel> open_sog(std::unique_ptr<NamedFiles> files, const std::string& meta_name,
                          ImportMemory& memory);

// Reads models as one static set: count() all of them, and then read() them in the same order.
class SogSet {
 public:
  explicit SogSet(ImportMemory& memory) : memory_(memory) {}

  void count(const SogModel& model);
  // kIo if the models are not those that were counted.
  Status read(const SogModel& model);
  // Returns the set, once all models have been read.
  Result<Scene> finish(ConversionNotes* notes);

 private:
  ImportMemory& memory_;
  std::uint64_t counted_ = 0;  // splats
  int sh_degree_ = 0;
  std::size_t done_ = 0;  // splats
  Gaussians4D set_;
  Lease lease_;  // of the set
};

}  // namespace stgs
