# The nodes on ROS 2 Jazzy (Ubuntu 24.04): docker build -t pmcl_ros . && docker run --ipc=host pmcl_ros
FROM ros:jazzy AS base
WORKDIR /ws
COPY package.xml src/pmcl_ros/package.xml
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        libegl1 libgl1 libgl1-mesa-dri libegl-mesa0 \
    && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths src --ignore-src -y --dependency-types exec \
    && rm -rf /var/lib/apt/lists/* \
    && chown -R ubuntu:ubuntu /ws
USER ubuntu

# What Ubuntu has not, or too old, in an environment that sees the rest. ROS's messages need numpy 1.
FROM base AS build
COPY --chown=ubuntu:ubuntu . src/pmcl_ros
RUN python3 -m venv --system-site-packages .venv \
    && touch .venv/COLCON_IGNORE \
    && .venv/bin/pip install --no-cache-dir -r src/pmcl_ros/requirements.txt 'numpy<2' \
    && . /opt/ros/jazzy/setup.sh \
    && .venv/bin/python -m colcon build --packages-select pmcl_ros

FROM base
COPY --from=build --chown=ubuntu:ubuntu /ws /ws
# The machine code of the kernels, for the kind of processor that builds the image.
ENV NUMBA_CACHE_DIR=/ws/kernels
RUN . install/setup.sh && install/pmcl_ros/lib/pmcl_ros/pmcl warm-up
CMD ["bash", "-c", ". install/setup.bash && exec ros2 launch pmcl_ros pmcl.launch.py"]
