# cabols in a ROS 2 Jazzy workspace, as docs/installing.md has it:
#   docker build -t cabols . && docker run --rm -it cabols ros2 run cabols_sim demo
FROM ros:jazzy-ros-base
SHELL ["/bin/bash", "-c"]
RUN apt-get update && apt-get install -y --no-install-recommends \
        python3-venv python3-rosdep python3-colcon-common-extensions \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /ws
COPY . src/cabols
RUN python3 -m venv --system-site-packages .python && touch .python/COLCON_IGNORE \
    && source .python/bin/activate && source /opt/ros/jazzy/setup.bash \
    && apt-get update && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths src --ignore-src --rosdistro jazzy -y \
        --skip-keys "python3-rosbags-pip python3-bokeh-pip" \
    && rm -rf /var/lib/apt/lists/* \
    && python -m pip install --no-cache-dir rosbags bokeh mcap zstandard daqp nicegui foxglove-sdk \
        "pydantic>=2" abb-robot-client "grpcio>=1.85.1" "protobuf>=7.35.1" \
    && python "$(command -v colcon)" build
RUN printf '#!/bin/bash\nsource /ws/.python/bin/activate\nsource /ws/install/setup.bash\nexec "$@"\n' \
        > /entry.sh && chmod +x /entry.sh
ENTRYPOINT ["/entry.sh"]
CMD ["bash"]
