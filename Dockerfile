# For a class, or a machine without Python:
#     docker build -t testbench .
#     docker run --rm -p 8888:8888 -v "$PWD":/work testbench                    # JupyterLab in this folder
#     docker run --rm -v "$PWD":/work testbench testbench exercise list         # any command
FROM python:3.11-slim
COPY . /opt/testbench
RUN pip install --no-cache-dir '/opt/testbench[teaching,geometry,campaign]' 'jupyterlab>=4.4'
RUN useradd --create-home student && mkdir /work && chown student /work
USER student
WORKDIR /work
EXPOSE 8888
CMD ["jupyter", "lab", "--ip=0.0.0.0", "--no-browser"]
