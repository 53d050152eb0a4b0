// SPDX-License-Identifier: Apache-2.0
// Exchange over the NCCL of the machine, loaded at run time so that the program starts without it.
#include <nccl.h>

#include <cstring>
#include <string>
#include <vector>

#include "backend/cuda/memory.h"
#include "backend/cuda/rank_exchange.h"
#include "backend/cuda/shared_library.h"

namespace stgs::encoder::cuda {
namespace {

constexpr const char* kLibrary = "libnccl.so.2";

// The functions in use. The library remains loaded.
struct Nccl {
  decltype(&::ncclGetUniqueId) get_unique_id;
  decltype(&::ncclCommInitRank) init_rank;
  decltype(&::ncclCommDestroy) destroy;
  decltype(&::ncclCommAbort) abort;
  decltype(&::ncclCommGetAsyncError) async_error;
  decltype(&::ncclAllGather) all_gather;
  decltype(&::ncclGetErrorString) error_string;

  static Result<Nccl> load();
  Status status(ncclResult_t result, const char* operation) const {
    if (result == ncclSuccess) return {};
    return runtime_error("NCCL failed while {}: {} (set NCCL_DEBUG=WARN for details)", operation,
                         error_string(result));
  }
};

Status missing(const std::string& reason) {
  return unsupported(
      "training on several GPUs requires NCCL 2: {}; install it, add its folder to LD_LIBRARY_PATH "
      "or "
      "use --backend cpu",
      reason);
}

Result<Nccl> Nccl::load() {
  SharedLibrary library(kLibrary);
  Nccl nccl{};
  library.find(nccl.get_unique_id, "ncclGetUniqueId");
  library.find(nccl.init_rank, "ncclCommInitRank");
  library.find(nccl.destroy, "ncclCommDestroy");
  library.find(nccl.abort, "ncclCommAbort");
  library.find(nccl.async_error, "ncclCommGetAsyncError");
  library.find(nccl.all_gather, "ncclAllGather");
  library.find(nccl.error_string, "ncclGetErrorString");
  if (!library.problem().empty()) return missing(library.problem());
  return nccl;
}

class NcclExchange final : public RankExchange {
 public:
  ~NcclExchange() override {
    if (comm_ != nullptr) nccl_.destroy(comm_);
  }
  Status create(Ranks& ranks);
  Status all_gather(void* blocks, std::size_t bytes, cudaStream_t stream) override {
    const auto* own = static_cast<const std::uint8_t*>(blocks) + rank_ * bytes;
    return nccl_.status(nccl_.all_gather(own, blocks, bytes, ncclUint8, comm_, stream),
                        "gathering between GPUs");
  }
  Status check() override {
    ncclResult_t result = ncclSuccess;
    STGS_TRY(nccl_.status(nccl_.async_error(comm_, &result), "querying errors"));
    return result == ncclInProgress ? Status() : nccl_.status(result, "gathering between GPUs");
  }
  void abort() override {
    if (comm_ != nullptr) nccl_.abort(comm_);
    comm_ = nullptr;
  }

 private:
  Nccl nccl_{};
  ncclComm_t comm_ = nullptr;
  std::size_t rank_ = 0;
};

// Returns kUnsupported if two ranks share a GPU, which NCCL does not support.
Status check_gpus(Ranks& ranks) {
  struct Gpu {
    char uuid[16];
  };
  int device = 0;
  cudaDeviceProp properties{};
  STGS_TRY(cuda_status(cudaGetDevice(&device), "querying the device"));
  STGS_TRY(cuda_status(cudaGetDeviceProperties(&properties, device), "querying the GPU"));
  Gpu own{};
  std::memcpy(own.uuid, &properties.uuid, sizeof(own.uuid));
  std::vector<Gpu> all(static_cast<std::size_t>(ranks.size()));
  STGS_TRY(ranks.all_gather(&own, sizeof(own), all.data()));
  for (std::size_t a = 0; a < all.size(); ++a) {
    for (std::size_t b = a + 1; b < all.size(); ++b) {
      if (std::memcmp(all[a].uuid, all[b].uuid, sizeof(own.uuid)) != 0) continue;
      return unsupported(
          "processes {} and {} of {} share a GPU ({}); start at most one process per GPU on each "
          "machine",
          a + 1, b + 1, all.size(), properties.name);
    }
  }
  return {};
}

Status NcclExchange::create(Ranks& ranks) {
  STGS_ASSIGN(nccl_, Nccl::load());
  STGS_TRY(check_gpus(ranks));
  rank_ = static_cast<std::size_t>(ranks.rank());
  ncclUniqueId own{};
  if (rank_ == 0) STGS_TRY(nccl_.status(nccl_.get_unique_id(&own), "starting"));
  std::vector<ncclUniqueId> all(static_cast<std::size_t>(ranks.size()));
  STGS_TRY(ranks.all_gather(&own, sizeof(own), all.data()));
  return nccl_.status(nccl_.init_rank(&comm_, ranks.size(), all[0], ranks.rank()),
                      "connecting the GPUs");
}

}  // namespace

Result<std::unique_ptr<RankExchange>> make_nccl_exchange(Ranks& ranks) {
  auto exchange = std::make_unique<NcclExchange>();
  STGS_TRY(exchange->create(ranks));
  return std::unique_ptr<RankExchange>(std::move(exchange));
}

}  // namespace stgs::encoder::cuda
