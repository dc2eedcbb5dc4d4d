// Decodes image 0 of a texture in blocks with Vulkan and compares it with the CPU: decode_vulkan FILE.txf SHADERS_DIR [RUNS].
// SHADERS_DIR holds what `texfold shaders dct --lang spirv --out SHADERS_DIR` writes. With RUNS the decoding is repeated and timed.
// Build: c++ -std=c++17 decode_vulkan.cpp -I include -ltexfold_c -lvulkan. Status 1: texels differ. Status 2: anything else failed.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <string>
#include <vector>

#include <texfold.h>
#include <vulkan/vulkan.h>

[[noreturn]] static void fail(const std::string &what) {
    std::fprintf(stderr, "error: %s\n", what.c_str());
    std::exit(2);
}

static void check(VkResult result, const std::string &call) {
    if (result != VK_SUCCESS) fail(call.substr(0, call.find('(')) + ": VkResult " + std::to_string(result));
}

static void check(TexfoldStatus status, const std::string &call) {
    if (status != TEXFOLD_STATUS_OK) fail(call.substr(0, call.find('(')) + ": " + texfold_error());
}

// Ends the program with the function's name where a call of Vulkan or Texfold fails.
#define CHECK(call) check((call), #call)
// Makes an object of the device, which is destroyed at the end; the structure's type and what follows it are given.
#define MAKE(Kind, ...) make("vkCreate" #Kind, vkCreate##Kind, vkDestroy##Kind, Vk##Kind##CreateInfo{__VA_ARGS__})

static std::vector<char> read_file(const std::string &path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) fail(path + " cannot be read");
    return {std::istreambuf_iterator<char>(file), {}};
}

// A device, a queue that computes, and what is freed at the end, last made first.
struct Vulkan {
    VkInstance instance{};
    VkPhysicalDevice physical{};
    VkPhysicalDeviceProperties properties{};
    VkPhysicalDeviceMemoryProperties memory{};
    uint32_t family = 0, timestamp_bits = 0;
    VkDevice device{};
    VkQueue queue{};
    VkCommandPool pool{};
    std::vector<std::function<void()>> cleanup;

    Vulkan() {
        VkApplicationInfo application{VK_STRUCTURE_TYPE_APPLICATION_INFO, nullptr, nullptr, 0, nullptr, 0, VK_API_VERSION_1_1};
        VkInstanceCreateInfo instance_info{VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, nullptr, 0, &application, 0, nullptr, 0, nullptr};
        CHECK(vkCreateInstance(&instance_info, nullptr, &instance));
        cleanup.push_back([this] { vkDestroyInstance(instance, nullptr); });
        choose();
        float priority = 1;
        VkDeviceQueueCreateInfo queues{VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO, nullptr, 0, family, 1, &priority};
        VkDeviceCreateInfo info{VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO, nullptr, 0, 1, &queues, 0, nullptr, 0, nullptr, nullptr};
        CHECK(vkCreateDevice(physical, &info, nullptr, &device));
        cleanup.push_back([this] { vkDestroyDevice(device, nullptr); });
        vkGetDeviceQueue(device, family, 0, &queue);
        pool = MAKE(CommandPool, VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO, nullptr, 0, family);
    }
    Vulkan(const Vulkan &) = delete;
    ~Vulkan() {
        for (auto one = cleanup.rbegin(); one != cleanup.rend(); ++one) (*one)();
    }

    // Takes a discrete device before an integrated one, and that before a virtual one or a CPU.
    void choose() {
        const VkPhysicalDeviceType order[] = {VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU, VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU,
            VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU, VK_PHYSICAL_DEVICE_TYPE_CPU};
        auto rank = [&](VkPhysicalDeviceType type) { return std::find(std::begin(order), std::end(order), type); };
        uint32_t count = 0;
        CHECK(vkEnumeratePhysicalDevices(instance, &count, nullptr));
        std::vector<VkPhysicalDevice> devices(count);
        CHECK(vkEnumeratePhysicalDevices(instance, &count, devices.data()));
        for (VkPhysicalDevice candidate : devices) {
            VkPhysicalDeviceProperties found;
            vkGetPhysicalDeviceProperties(candidate, &found);
            VkQueueFamilyProperties families[16];
            uint32_t first = 0, all = 16;
            vkGetPhysicalDeviceQueueFamilyProperties(candidate, &all, families);
            while (first < all && !(families[first].queueFlags & VK_QUEUE_COMPUTE_BIT)) first++;
            // The shaders are SPIR-V 1.3, which devices read from Vulkan 1.1 on.
            if (first == all || found.apiVersion < VK_API_VERSION_1_1) continue;
            if (physical && rank(found.deviceType) >= rank(properties.deviceType)) continue;
            physical = candidate;
            properties = found;
            family = first;
            timestamp_bits = families[first].timestampValidBits;
        }
        if (!physical) fail("no device has Vulkan 1.1 and a queue that computes");
        vkGetPhysicalDeviceMemoryProperties(physical, &memory);
    }

    template <class Handle, class Info>
    Handle make(const char *name, VkResult(VKAPI_PTR *create)(VkDevice, const Info *, const VkAllocationCallbacks *, Handle *),
        void(VKAPI_PTR *destroy)(VkDevice, Handle, const VkAllocationCallbacks *), const Info &info) {
        Handle made;
        check(create(device, &info, nullptr, &made), name);
        cleanup.push_back([on = device, made, destroy] { destroy(on, made, nullptr); });
        return made;
    }

    // Memory with the properties that are needed, and those that are preferred where the device has such memory.
    VkDeviceMemory allocate(const VkMemoryRequirements &of, VkMemoryPropertyFlags needed, VkMemoryPropertyFlags preferred) {
        for (VkMemoryPropertyFlags flags : {needed | preferred, needed})
            for (uint32_t type = 0; type < memory.memoryTypeCount; type++)
                if ((of.memoryTypeBits >> type & 1) && (memory.memoryTypes[type].propertyFlags & flags) == flags)
                    return make("vkAllocateMemory", vkAllocateMemory, vkFreeMemory,
                        VkMemoryAllocateInfo{VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, nullptr, of.size, type});
        fail("the device has no memory of the kind that is needed");
    }

    // A buffer; where `mapped` is given, its bytes are mapped there.
    VkBuffer buffer(size_t size, VkBufferUsageFlags usage, VkMemoryPropertyFlags preferred, void **mapped = nullptr) {
        VkBuffer made = MAKE(Buffer, VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, nullptr, 0, size, usage, VK_SHARING_MODE_EXCLUSIVE, 0, nullptr);
        VkMemoryRequirements of;
        vkGetBufferMemoryRequirements(device, made, &of);
        const VkMemoryPropertyFlags host = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
        VkDeviceMemory bytes = allocate(of, mapped ? host : 0, preferred);
        CHECK(vkBindBufferMemory(device, made, bytes, 0));
        if (mapped) CHECK(vkMapMemory(device, bytes, 0, VK_WHOLE_SIZE, 0, mapped));
        return made;
    }

    // A buffer with these bytes.
    VkBuffer filled(const void *bytes, size_t size, VkBufferUsageFlags usage) {
        void *mapped;
        VkBuffer made = buffer(size, usage, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT, &mapped);
        std::memcpy(mapped, bytes, size);
        return made;
    }

    VkCommandBuffer begin() {
        VkCommandBufferAllocateInfo info{
            VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, nullptr, pool, VK_COMMAND_BUFFER_LEVEL_PRIMARY, 1};
        VkCommandBuffer commands;
        CHECK(vkAllocateCommandBuffers(device, &info, &commands));
        VkCommandBufferBeginInfo usage{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO, nullptr, 0, nullptr};
        CHECK(vkBeginCommandBuffer(commands, &usage));
        return commands;
    }

    void submit_and_wait(VkCommandBuffer commands) {
        VkSubmitInfo info{VK_STRUCTURE_TYPE_SUBMIT_INFO, nullptr, 0, nullptr, nullptr, 1, &commands, 0, nullptr};
        CHECK(vkQueueSubmit(queue, 1, &info, VK_NULL_HANDLE));
        CHECK(vkQueueWaitIdle(queue));
    }
};

// Scratch memory: large textures take 1.6 times as long within half of it.
const uint64_t MAX_SCRATCH = 256 << 20;

// Stages and accesses of the decoder on the device.
const VkPipelineStageFlags STAGES = VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT;
const VkAccessFlags WRITES = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
const VkAccessFlags ACCESSES = WRITES | VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_TRANSFER_READ_BIT;

// Makes the commands that follow wait for those before, and see what they wrote.
static void barrier(VkCommandBuffer commands, VkPipelineStageFlags stages = STAGES, VkAccessFlags accesses = ACCESSES) {
    VkMemoryBarrier memory{VK_STRUCTURE_TYPE_MEMORY_BARRIER, nullptr, WRITES, accesses};
    vkCmdPipelineBarrier(commands, STAGES, stages, 0, 1, &memory, 0, nullptr, 0, nullptr);
}

// A texture in blocks, the program that decodes it, and the descriptor sets of group 0 and, for each level, of group 1.
struct Part {
    TexfoldBlocksInfo blocks;
    TexfoldProgramInfo program;
    VkDescriptorSet passes;
    std::vector<VkDescriptorSet> outputs;
};

// The parts of image 0, the image that they are decoded to, and the decoder's shader.
struct Decoder : Vulkan {
    std::vector<Part> parts;
    TexfoldDecodedInfo decoded{};
    bool is_deep = false;
    VkFormat format = VK_FORMAT_R8G8B8A8_UNORM;
    VkImage image{};
    VkDescriptorSetLayout groups[2]{};
    VkDescriptorPool sets{};
    VkPipelineLayout layout{};
    VkShaderModule module{};
    std::map<std::string, VkPipeline> pipelines;
    VkBuffer scratch{};

    Decoder(const TexfoldGpu *gpu, const std::string &shaders) {
        find_parts(gpu);
        make_image();
        make_layouts();
        const std::vector<char> code = read_file(shaders + "/" + parts.front().blocks.shader + ".spv");
        module = MAKE(ShaderModule, VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, nullptr, 0, code.size() / 4 * 4,
            reinterpret_cast<const uint32_t *>(code.data()));
        size_t scratch_size = 0;
        for (const Part &part : parts) scratch_size = std::max<size_t>(scratch_size, part.program.scratch_size);
        const VkBufferUsageFlags usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT;
        scratch = buffer(scratch_size, usage, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT);
        for (Part &part : parts) bind(part);
    }

    VkExtent3D extent(uint32_t level) const { return {std::max(decoded.width >> level, 1u), std::max(decoded.height >> level, 1u), 1}; }

    void find_parts(const TexfoldGpu *gpu) {
        TexfoldGpuInfo info;
        CHECK(texfold_gpu_info(gpu, &info));
        if (info.decoded == 0) fail(std::string("nothing is in blocks; the shader ") + info.module + " reads texels from planes");
        CHECK(texfold_gpu_decoded(gpu, 0, &decoded));
        for (uint32_t n = 0; n < info.blocks; n++) {
            TexfoldBlocksInfo blocks;
            CHECK(texfold_gpu_blocks(gpu, n, &blocks));
            if (blocks.decoded != 0) continue;
            TexfoldProgram *program;
            CHECK(texfold_program_new(gpu, n, nullptr, 0, 0, MAX_SCRATCH, &program));
            cleanup.push_back([program] { texfold_program_free(program); });
            parts.push_back({blocks, {}, {}, std::vector<VkDescriptorSet>(blocks.levels)});
            CHECK(texfold_program_info(program, &parts.back().program));
        }
        is_deep = decoded.bits > 8;
        if (is_deep) format = VK_FORMAT_R16G16B16A16_UINT;
    }

    void make_image() {
        if (std::max(decoded.width, decoded.height) > properties.limits.maxImageDimension2D) fail("the image is too large for the device");
        image = MAKE(Image, VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO, nullptr, 0, VK_IMAGE_TYPE_2D, format, extent(0), decoded.levels, 1,
            VK_SAMPLE_COUNT_1_BIT, VK_IMAGE_TILING_OPTIMAL,
            VK_IMAGE_USAGE_STORAGE_BIT | VK_IMAGE_USAGE_SAMPLED_BIT | VK_IMAGE_USAGE_TRANSFER_SRC_BIT, VK_SHARING_MODE_EXCLUSIVE, 0,
            nullptr, VK_IMAGE_LAYOUT_UNDEFINED);
        VkMemoryRequirements of;
        vkGetImageMemoryRequirements(device, image, &of);
        CHECK(vkBindImageMemory(device, image, allocate(of, 0, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT), 0));
    }

    // Groups of the shader are descriptor sets; uniform buffers have their offset with each dispatch.
    void make_layouts() {
        const VkDescriptorType uniform = VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER_DYNAMIC, storage = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
        const VkDescriptorType target = VK_DESCRIPTOR_TYPE_STORAGE_IMAGE;
        const VkShaderStageFlags stage = VK_SHADER_STAGE_COMPUTE_BIT;
        const VkDescriptorSetLayoutBinding decode[] = {{0, uniform, 1, stage, nullptr}, {1, storage, 1, stage, nullptr},
            {2, storage, 1, stage, nullptr}, {3, storage, 1, stage, nullptr}};
        const VkDescriptorSetLayoutBinding write[] = {{0, uniform, 1, stage, nullptr}, {1, target, 1, stage, nullptr}};
        groups[0] = MAKE(DescriptorSetLayout, VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, nullptr, 0, 4, decode);
        groups[1] = MAKE(DescriptorSetLayout, VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, nullptr, 0, 2, write);
        layout = MAKE(PipelineLayout, VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO, nullptr, 0, 2, groups, 0, nullptr);
        const uint32_t passes = static_cast<uint32_t>(parts.size());
        uint32_t outputs = 0;
        for (const Part &part : parts) outputs += part.blocks.levels;
        const VkDescriptorPoolSize sizes[] = {{uniform, passes + outputs}, {storage, 3 * passes}, {target, outputs}};
        sets = MAKE(DescriptorPool, VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO, nullptr, 0, passes + outputs, 3, sizes);
    }

    // A descriptor set of a group: parameters, and from binding 1 on buffers or an image.
    VkDescriptorSet set(uint32_t group, VkDescriptorBufferInfo parameters, uint32_t count, VkDescriptorType type,
        const VkDescriptorBufferInfo *buffers, const VkDescriptorImageInfo *target) {
        VkDescriptorSetAllocateInfo info{VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO, nullptr, sets, 1, &groups[group]};
        VkDescriptorSet made;
        CHECK(vkAllocateDescriptorSets(device, &info, &made));
        const VkStructureType write = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
        const VkWriteDescriptorSet writes[] = {
            {write, nullptr, made, 0, 0, 1, VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER_DYNAMIC, nullptr, &parameters, nullptr},
            {write, nullptr, made, 1, 0, count, type, target, buffers, nullptr}};
        vkUpdateDescriptorSets(device, 2, writes, 0, nullptr);
        return made;
    }

    // Makes a part's buffers and descriptor sets.
    void bind(Part &part) {
        const VkBufferUsageFlags uniform = VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT, storage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT;
        const TexfoldProgramInfo &program = part.program;
        VkBuffer passes = filled(program.passes, program.passes_size, uniform);
        VkBuffer outputs = filled(program.outputs, program.outputs_size, uniform);
        VkBuffer words = filled(part.blocks.words, 4 * part.blocks.words_count, storage);
        VkBuffer streams = filled(part.blocks.streams, part.blocks.streams_size, storage);
        const VkDescriptorBufferInfo buffers[] = {{words, 0, VK_WHOLE_SIZE}, {streams, 0, VK_WHOLE_SIZE}, {scratch, 0, VK_WHOLE_SIZE}};
        part.passes = set(0, {passes, 0, program.pass_size}, 3, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, buffers, nullptr);
        uint32_t level = part.blocks.level;
        for (VkDescriptorSet &output : part.outputs) {
            VkImageView view = MAKE(ImageView, VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO, nullptr, 0, image, VK_IMAGE_VIEW_TYPE_2D, format,
                {}, {VK_IMAGE_ASPECT_COLOR_BIT, level++, 1, 0, 1});
            const VkDescriptorImageInfo target{VK_NULL_HANDLE, view, VK_IMAGE_LAYOUT_GENERAL};
            output = set(1, {outputs, 0, program.output_size}, 1, VK_DESCRIPTOR_TYPE_STORAGE_IMAGE, nullptr, &target);
        }
    }

    VkPipeline pipeline(const char *entry) {
        VkPipeline &kept = pipelines[entry];
        if (kept) return kept;
        VkComputePipelineCreateInfo info{VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO, nullptr, 0,
            {VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO, nullptr, 0, VK_SHADER_STAGE_COMPUTE_BIT, module, entry, nullptr},
            layout, VK_NULL_HANDLE, 0};
        CHECK(vkCreateComputePipelines(device, VK_NULL_HANDLE, 1, &info, nullptr, &kept));
        cleanup.push_back([on = device, made = kept] { vkDestroyPipeline(on, made, nullptr); });
        return kept;
    }

    // Records the dispatches of all parts.
    void decode(VkCommandBuffer commands) {
        const VkPipelineBindPoint point = VK_PIPELINE_BIND_POINT_COMPUTE;
        for (const Part &part : parts)
            for (size_t n = 0; n < part.program.dispatch_count; n++) {
                const TexfoldDispatch &dispatch = part.program.dispatches[n];
                barrier(commands);
                if (dispatch.clears) {
                    vkCmdFillBuffer(commands, scratch, 0, part.program.scratch_size, 0);
                    barrier(commands);
                }
                vkCmdBindPipeline(commands, point, pipeline(dispatch.entry));
                vkCmdBindDescriptorSets(commands, point, layout, 0, 1, &part.passes, 1, &dispatch.pass_offset);
                if (dispatch.writes)
                    vkCmdBindDescriptorSets(commands, point, layout, 1, 1, &part.outputs[dispatch.level], 1, &dispatch.output_offset);
                vkCmdDispatch(commands, dispatch.groups[0], dispatch.groups[1], dispatch.groups[2]);
            }
    }

    // Decodes once, and where `runs` is not 0 so often again, of which the median time is printed.
    void run(size_t runs) {
        const bool is_timed = runs > 0;
        if (is_timed && timestamp_bits == 0) fail("the queue has no timestamps");
        VkQueryPool queries = MAKE(QueryPool, VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO, nullptr, 0, VK_QUERY_TYPE_TIMESTAMP, 2, 0);
        VkCommandBuffer commands = begin();
        // What the image held is not kept.
        VkImageMemoryBarrier general{VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER, nullptr, 0, ACCESSES, VK_IMAGE_LAYOUT_UNDEFINED,
            VK_IMAGE_LAYOUT_GENERAL, VK_QUEUE_FAMILY_IGNORED, VK_QUEUE_FAMILY_IGNORED, image, {VK_IMAGE_ASPECT_COLOR_BIT, 0, decoded.levels, 0, 1}};
        vkCmdPipelineBarrier(commands, STAGES, STAGES, 0, 0, nullptr, 0, nullptr, 1, &general);
        vkCmdResetQueryPool(commands, queries, 0, 2);
        if (is_timed) vkCmdWriteTimestamp(commands, VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT, queries, 0);
        decode(commands);
        if (is_timed) vkCmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, queries, 1);
        CHECK(vkEndCommandBuffer(commands));
        submit_and_wait(commands);
        if (!is_timed) return;
        std::vector<double> times(runs);
        for (double &milliseconds : times) {
            submit_and_wait(commands);
            uint64_t at[2];
            CHECK(vkGetQueryPoolResults(device, queries, 0, 2, sizeof at, at, sizeof at[0], VK_QUERY_RESULT_64_BIT));
            uint64_t ticks = (at[1] - at[0]) & (~uint64_t{0} >> (64 - timestamp_bits));
            milliseconds = 1e-6 * properties.limits.timestampPeriod * static_cast<double>(ticks);
        }
        std::sort(times.begin(), times.end());
        double median = times[runs / 2];
        std::printf("median of %zu: %.3f ms, %.1f megatexels/s\n", runs, median, 1e-3 * decoded.width * decoded.height / median);
    }

    // Reads a level back and compares it with what the CPU decodes.
    bool is_equal(const TexfoldTexture *texture, uint32_t level) {
        const size_t size = size_t{is_deep ? 8u : 4u} * extent(level).width * extent(level).height;
        void *mapped;
        VkBuffer texels = buffer(size, VK_BUFFER_USAGE_TRANSFER_DST_BIT, VK_MEMORY_PROPERTY_HOST_CACHED_BIT, &mapped);
        VkCommandBuffer commands = begin();
        barrier(commands);
        VkBufferImageCopy copy{0, 0, 0, {VK_IMAGE_ASPECT_COLOR_BIT, level, 0, 1}, {}, extent(level)};
        vkCmdCopyImageToBuffer(commands, image, VK_IMAGE_LAYOUT_GENERAL, texels, 1, &copy);
        barrier(commands, VK_PIPELINE_STAGE_HOST_BIT, VK_ACCESS_HOST_READ_BIT);
        CHECK(vkEndCommandBuffer(commands));
        submit_and_wait(commands);

        std::vector<uint16_t> pixels(size / 2);
        auto *bytes = reinterpret_cast<uint8_t *>(pixels.data());
        const TexfoldRegion region{0, level, 0, 0, 0, 0};
        if (is_deep) CHECK(texfold_decode_rgba16(texture, region, pixels.data(), size, 0));
        else CHECK(texfold_decode_rgba8(texture, region, bytes, size, 0));
        size_t unequal = 0;
        for (size_t n = 0; n < size; n++) unequal += static_cast<const uint8_t *>(mapped)[n] != bytes[n];
        std::printf("level %u: %ux%u ", level, extent(level).width, extent(level).height);
        if (unequal == 0) std::printf("equal\n");
        else std::printf("%zu of %zu bytes differ\n", unequal, size);
        return unequal == 0;
    }
};

int main(int count, char **names) {
    if (count < 3 || count > 4) return std::fprintf(stderr, "usage: decode_vulkan FILE.txf SHADERS_DIR [RUNS]\n"), 2;
    const size_t runs = count > 3 ? std::strtoul(names[3], nullptr, 10) : 0;
    const std::vector<char> file = read_file(names[1]);
    TexfoldTexture *texture;
    CHECK(texfold_open(reinterpret_cast<const uint8_t *>(file.data()), file.size(), nullptr, &texture));
    TexfoldGpu *gpu;
    CHECK(texfold_gpu_new(texture, &gpu));
    TexfoldInfo info;
    CHECK(texfold_info(texture, &info));

    bool all_equal = true;
    {
        Decoder decoder(gpu, names[2]);
        std::printf("%s, %ux%u\n", decoder.properties.deviceName, decoder.decoded.width, decoder.decoded.height);
        decoder.run(runs);
        // Of other codecs the blocks hold what their shaders draw texels from.
        const bool has_texels = std::strcmp(info.codec, "dct") == 0;
        if (!has_texels) std::printf("not compared: codec %s draws its texels from what blocks hold\n", info.codec);
        for (uint32_t level = 0; has_texels && level < decoder.decoded.levels; level++) all_equal &= decoder.is_equal(texture, level);
    }
    texfold_gpu_free(gpu);
    texfold_close(texture);
    return all_equal ? 0 : 1;
}
